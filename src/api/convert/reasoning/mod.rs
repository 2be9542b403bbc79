//! Questions, simulations and words: requests to plain data, and results to replies.

pub mod concepts;
pub mod interventions;
pub mod question;
pub mod simulation;
