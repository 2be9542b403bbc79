//! Videos: stored once under the digest of their content, read, listed and deleted.

use super::error::EngineError;
use super::state::Engine;
use crate::scene::Scene;
use crate::store::TableKind;
use std::sync::Arc;

impl Engine {
    /// Stores the scene that `make` returns (it runs on the ingest pool) and returns its id. The id is a digest of the
    /// scene alone, so storing the same scene again changes nothing.
    pub async fn create_video<F>(&self, make: F) -> Result<(String, Arc<Scene>), EngineError>
    where
        F: FnOnce() -> Result<Scene, EngineError> + Send + 'static,
    {
        let made = self.ingest_pool.run(self.uncancelled(), move |_| {
            let scene = make()?;
            Ok((scene.digest(), scene))
        });
        let ((id, scene), _slot) = made.await?;
        self.store.put_video(&id, &scene).await?;
        Ok((id, Arc::new(scene)))
    }

    pub async fn video(&self, id: &str) -> Result<Arc<Scene>, EngineError> {
        let key = self.key(id);
        if let Some(scene) = self.scenes.get(&key) {
            return Ok(scene);
        }
        let found = self.store.get::<Scene>(TableKind::Videos, id).await?;
        let scene = Arc::new(found.ok_or_else(|| EngineError::no_video(id))?);
        self.scenes.insert(key, scene.clone());
        Ok(scene)
    }

    /// Up to `limit` videos after the id `after`, by id.
    pub async fn videos(&self, after: &str, limit: usize) -> Result<Vec<(String, Scene)>, EngineError> {
        Ok(self.store.list(TableKind::Videos, "", after, limit, |_: &Scene| true).await?)
    }

    /// Deletes a video with its models and traces.
    pub async fn delete_video(&self, id: &str) -> Result<(), EngineError> {
        let found = self.store.delete_video(id).await;
        self.forget();
        if found? { Ok(()) } else { Err(EngineError::no_video(id)) }
    }
}
