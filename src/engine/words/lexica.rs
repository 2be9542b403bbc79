//! Lexica: kept under the digest of their content, listed and deleted.

use crate::concepts::{Lexicon, WordKind, word_probabilities};
use crate::engine::error::EngineError;
use crate::engine::model_source::ModelSource;
use crate::engine::state::Engine;
use crate::reason::WordProbabilities;
use crate::scene::Scene;
use crate::store::TableKind;
use std::sync::Arc;

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

    /// How probable the words of a stored lexicon are of the objects of a video. Words of motion know its default model.
    pub async fn words_of_video(
        self: &Arc<Self>,
        id: &str,
        video: &str,
    ) -> Result<(Arc<Scene>, WordProbabilities), EngineError> {
        let (lexicon, scene) = (self.lexicon(id).await?, self.video(video).await?);
        let fitted = match lexicon.words.iter().any(|w| w.kind == WordKind::Dynamic) {
            true => Some(self.drawn(video, &scene, &ModelSource::default_of("model")).await?),
            false => None,
        };
        let fit = fitted.as_ref().map(|f| (&f.fit, 0));
        let words = word_probabilities(&lexicon, &scene, fit)?;
        Ok((scene, words))
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
