//! Questions: understood, and answered once from equal requests.
//!
//! `asked` (what a caller asks) -> `parse` (its program, nothing simulated) -> `answer` (simulations, their traces, the answer).
//! `discovered`: what stored discoveries say of the model.
//! Where our own reader does not understand a text, `chat` may ask a language model for the program.

mod answer;
mod asked;
mod chat;
mod discovered;
mod parse;

pub use asked::AskedQuestion;
pub use chat::{ChatParser, ChatSettings};
pub use parse::Parsed;
