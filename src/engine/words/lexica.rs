//! Lexica: kept under the digest of their content, listed and deleted.

use crate::concepts::Lexicon;
use crate::engine::error::EngineError;
use crate::engine::state::Engine;
use crate::store::TableKind;

impl Engine {
    /// Stores a lexicon that was learned elsewhere; returns its id.
    pub async fn put_lexicon(&self, lexicon: &Lexicon) -> Result<String, EngineError> {
        lexicon.check()?;
        let id = lexicon.digest();
        self.store.put_lexicon(&id, lexicon).await?;
        Ok(id)
    }

    /// A stored lexicon.
    pub async fn lexicon(&self, id: &str) -> Result<Lexicon, EngineError> {
        let found = self.store.get(TableKind::Lexica, id).await?;
        found.ok_or_else(|| EngineError::NotFound { name: format!("lexica/{id}") })
    }

    /// Up to `limit` lexica after the one with the id `after`, by id.
    pub async fn lexica(&self, after: &str, limit: usize) -> Result<Vec<(String, Lexicon)>, EngineError> {
        Ok(self.store.list(TableKind::Lexica, "", after, limit, |_: &Lexicon| true).await?)
    }

    /// Deletes a lexicon. Answers that it gave are forgotten.
    pub async fn delete_lexicon(&self, id: &str) -> Result<(), EngineError> {
        match self.store.delete_lexicon(id).await? {
            true => {
                self.forget_all();
                Ok(())
            }
            false => Err(EngineError::NotFound { name: format!("lexica/{id}") }),
        }
    }
}
