//! The service `Traces`.

use super::{RpcResult, RpcStream, Services};
use crate::api::convert::trace;
use crate::api::convert::violations::trace_id;
use crate::api::status::status;
use crate::api::v1;
use futures_util::stream::{self, StreamExt};
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::traces_server::Traces for Services {
    type DownloadTraceStream = RpcStream<v1::DownloadTraceResponse>;

    async fn list_traces(
        &self,
        request: Request<v1::ListTracesRequest>,
    ) -> RpcResult<v1::ListTracesResponse> {
        let owner = self.owner(&request);
        let (filter, size, after) = trace::list(request.into_inner()).map_err(status)?;
        let listed = owner.list_traces(filter, &after, size).await.map_err(status)?;
        let next_page_token = listed.next.unwrap_or_default();
        let unreadable_count = listed.unreadable as u32;
        let traces = listed.rows.into_iter().map(|row| trace::trace(row.value)).collect();
        Ok(Response::new(v1::ListTracesResponse { traces, next_page_token, unreadable_count }))
    }

    async fn download_trace(
        &self,
        request: Request<v1::DownloadTraceRequest>,
    ) -> RpcResult<Self::DownloadTraceStream> {
        let owner = self.owner(&request);
        let id = trace_id("name", &request.into_inner().name).map_err(status)?;
        let download = owner.download(&id).await.map_err(status)?;
        let chunks = stream::try_unfold(download, async |mut download| {
            let (offset, data) = download.next().await.map_err(status)?;
            let reply = v1::DownloadTraceResponse { offset, data: data.into() };
            Ok((!reply.data.is_empty()).then_some((reply, download)))
        });
        Ok(Response::new(chunks.boxed()))
    }

    type ReplayTraceStream = RpcStream<v1::ReplayTraceResponse>;

    async fn replay_trace(
        &self,
        request: Request<v1::ReplayTraceRequest>,
    ) -> RpcResult<Self::ReplayTraceStream> {
        let owner = self.owner(&request);
        let (id, options) = trace::replay(request.into_inner()).map_err(status)?;
        let replay = owner.replay(&id, options).await.map_err(status)?;
        let items = stream::unfold(replay, |mut replay| async move {
            let item = replay.next().await?;
            let reply = item.map(|(round, time, item)| trace::played(round, time, item)).map_err(status);
            Some((reply, replay))
        });
        Ok(Response::new(items.boxed()))
    }
}
