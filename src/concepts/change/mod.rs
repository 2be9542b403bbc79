//! A word for a change: the factor of a mass, a velocity, a restitution or a friction.
//!
//! | file | job |
//! |---|---|
//! | `answers` | from questions about what would happen, and their answers |
//! | `examples` | from pairs of videos: one as it is, and one with the object changed |
//! | `likelihood` | how well each factor explains the second video of a pair |
//! | `grid` | the posterior of the logarithm of the factor |
//! | `word` | the word of a lexicon, and the refusal of one |

mod answers;
mod examples;
mod grid;
mod likelihood;
mod word;

pub use answers::{ChangeOptions, learn_change};
pub use examples::{ChangeExample, learn_change_from_examples};
