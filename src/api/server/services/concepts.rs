//! The service `Concepts`.

use super::updates::{LongCall, long_call, replies};
use super::{RpcResult, RpcStream, Services, cut_page};
use crate::api::convert::reasoning::concepts;
use crate::api::convert::reasoning::question::word_of_object;
use crate::api::convert::violations::check_request_id;
use crate::api::status::status;
use crate::api::v1;
use crate::concepts::{Lexicon, describe};
use crate::engine::{Engine, EngineError};
use std::sync::Arc;
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::concepts_server::Concepts for Services {
    type LearnConceptsStream = RpcStream<v1::LearnConceptsResponse>;

    async fn learn_concepts(
        &self,
        request: Request<v1::LearnConceptsRequest>,
    ) -> RpcResult<Self::LearnConceptsStream> {
        use v1::learn_concepts_response::Event;
        let owner = self.owner(&request);
        let call = learn(&owner, request.into_inner()).await;
        let progress = |status: v1::Progress| v1::LearnConceptsResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::LearnConceptsResponse {
            event: Some(Event::Lexicon(found)),
            status: None,
        })
    }

    async fn create_lexicon(&self, request: Request<v1::CreateLexiconRequest>) -> RpcResult<v1::Lexicon> {
        let owner = self.owner(&request);
        let lexicon = concepts::content(&request.into_inner().content).map_err(status)?;
        let id = owner.put_lexicon(&lexicon).await.map_err(status)?;
        Ok(Response::new(concepts::lexicon(&id, &lexicon)))
    }

    async fn get_lexicon(&self, request: Request<v1::GetLexiconRequest>) -> RpcResult<v1::Lexicon> {
        let owner = self.owner(&request);
        let id = concepts::lexicon_id("name", &request.into_inner().name).map_err(status)?;
        let found = owner.lexicon(&id).await.map_err(status)?;
        Ok(Response::new(concepts::whole_lexicon(&found)))
    }

    async fn list_lexica(
        &self,
        request: Request<v1::ListLexicaRequest>,
    ) -> RpcResult<v1::ListLexicaResponse> {
        let owner = self.owner(&request);
        let (size, after) = concepts::page(request.into_inner()).map_err(status)?;
        let mut rows = owner.lexica(&after, size + 1).await.map_err(status)?;
        let next_page_token = cut_page(&mut rows, size, |row| &row.0);
        let lexica = rows.iter().map(|(id, lexicon)| concepts::lexicon(id, lexicon)).collect();
        Ok(Response::new(v1::ListLexicaResponse { lexica, next_page_token }))
    }

    async fn delete_lexicon(&self, request: Request<v1::DeleteLexiconRequest>) -> RpcResult<()> {
        let owner = self.owner(&request);
        let id = concepts::lexicon_id("name", &request.into_inner().name).map_err(status)?;
        owner.delete_lexicon(&id).await.map_err(status)?;
        Ok(Response::new(()))
    }

    async fn list_concepts(
        &self,
        request: Request<v1::ListConceptsRequest>,
    ) -> RpcResult<v1::ListConceptsResponse> {
        let owner = self.owner(&request);
        let id = concepts::lexicon_id("lexicon", &request.into_inner().lexicon).map_err(status)?;
        let found = owner.lexicon(&id).await.map_err(status)?;
        let concepts = concepts::concepts(&found).map_err(status)?;
        Ok(Response::new(v1::ListConceptsResponse { concepts }))
    }

    async fn describe_concept(&self, request: Request<v1::DescribeConceptRequest>) -> RpcResult<v1::Concept> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let id = concepts::lexicon_id("lexicon", &given.lexicon).map_err(status)?;
        let found = owner.lexicon(&id).await.map_err(status)?;
        let word = describe(&found, &given.word).map_err(|e| status(e.into()))?;
        let mut concept = concepts::concept(&word);
        if let Some(video) = concepts::described_video(&given.video).map_err(status)? {
            let (scene, words) = owner.words_of_video(&id, &video).await.map_err(status)?;
            let found = words.of_objects(&scene, &[given.word]);
            concept.objects = found.iter().map(word_of_object).collect();
        }
        Ok(Response::new(concept))
    }
}

/// The lexicon of a request, with its content.
pub async fn learn(
    owner: &Arc<Engine>,
    given: v1::LearnConceptsRequest,
) -> Result<LongCall<v1::Lexicon>, EngineError> {
    check_request_id(&given.request_id)?;
    let request_id = given.request_id.clone();
    let (base, request, seed) = concepts::learn_request(given)?;
    let job = owner.learn(base.as_deref(), request, seed).await?;
    tracing::info!(request_id, "words are learned");
    long_call(job, async |lexicon: Arc<Lexicon>| Ok(concepts::whole_lexicon(&lexicon))).await
}
