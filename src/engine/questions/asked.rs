//! What a caller asks.

use crate::reason::{Conversation, Question};
use serde::Serialize;

/// A question with what is needed to understand it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AskedQuestion {
    pub question: Question,
    /// The questions before it, and the caller's own words.
    pub conversation: Conversation,
    /// Id of the lexicon whose words describe the objects.
    pub lexicon: Option<String>,
}

impl AskedQuestion {
    /// The same question, with this lexicon if it names none.
    pub fn or_with(mut self, lexicon: Option<&String>) -> AskedQuestion {
        self.lexicon = self.lexicon.or_else(|| lexicon.cloned());
        self
    }
}
