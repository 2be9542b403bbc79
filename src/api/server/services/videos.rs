//! The service `Videos`.

use super::import::{ImportRoom, import_video};
use super::{RpcResult, RpcStream, Services, calls, cut_page, held};
use crate::api::convert::ingest::camera::{calibration, pairs, uncalibrated};
use crate::api::convert::ingest::stills::still_message;
use crate::api::convert::video::video_message;
use crate::api::convert::violations::video_id;
use crate::api::convert::{listing, trace::timestamp};
use crate::api::server::request_body::holder;
use crate::api::status::status;
use crate::api::v1;
use crate::engine::JobKind;
use crate::num::Stop;
use crate::scene::calibrate;
use tonic::{Request, Response, Streaming};

#[tonic::async_trait]
impl v1::videos_server::Videos for Services {
    async fn create_video(&self, request: Request<v1::CreateVideoRequest>) -> RpcResult<v1::Video> {
        let owner = self.owner(&request);
        let held = held(&request);
        let video = calls::create_video(&owner, request.into_inner(), held).await.map_err(status)?;
        Ok(Response::new(video))
    }

    type ImportVideoStream = RpcStream<v1::ImportVideoResponse>;

    async fn import_video(
        &self,
        request: Request<Streaming<v1::ImportVideoRequest>>,
    ) -> RpcResult<Self::ImportVideoStream> {
        let owner = self.owner(&request);
        let room = ImportRoom { budget: self.imports.clone(), holder: holder(request.extensions()) };
        import_video(owner, request.into_inner(), room).await
    }

    async fn get_video(&self, request: Request<v1::GetVideoRequest>) -> RpcResult<v1::Video> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let id = video_id("name", &given.name).map_err(status)?;
        let mask = listing::mask(given.read_mask, "Video").map_err(status)?;
        let scene = owner.video(&id).await.map_err(status)?;
        let create_time = owner.video_created_ms(&id).await.map_err(status)?.map(timestamp);
        let stills = owner.stills(&id).await.map_err(status)?.iter().map(still_message).collect();
        let video = v1::Video { create_time, stills, ..video_message(&id, &scene, true) };
        Ok(Response::new(mask.apply(video)))
    }

    async fn list_videos(
        &self,
        request: Request<v1::ListVideosRequest>,
    ) -> RpcResult<v1::ListVideosResponse> {
        let owner = self.owner(&request);
        let asked = listing::videos(request.into_inner()).map_err(status)?;
        let listed = owner.list_videos(asked.filter, &asked.after, asked.size).await.map_err(status)?;
        let videos = listed.rows.iter().map(|row| asked.mask.apply(listing::video(row))).collect();
        let next_page_token = listed.next.unwrap_or_default();
        let unreadable_count = listed.unreadable as u32;
        Ok(Response::new(v1::ListVideosResponse { videos, next_page_token, unreadable_count }))
    }

    async fn list_setups(
        &self,
        request: Request<v1::ListSetupsRequest>,
    ) -> RpcResult<v1::ListSetupsResponse> {
        let owner = self.owner(&request);
        let (prefix, size, after) = listing::setups(request.into_inner()).map_err(status)?;
        let (mut rows, unreadable) = owner.list_setups(&prefix, &after, size + 1).await.map_err(status)?;
        let next_page_token = listing::token(&cut_page(&mut rows, size, |row| &row.name));
        let setups = rows.into_iter().map(listing::setup).collect();
        Ok(Response::new(v1::ListSetupsResponse {
            setups,
            next_page_token,
            unreadable_count: unreadable as u32,
        }))
    }

    async fn delete_video(&self, request: Request<v1::DeleteVideoRequest>) -> RpcResult<()> {
        let owner = self.owner(&request);
        let id = video_id("name", &request.into_inner().name).map_err(status)?;
        owner.delete_video(&id).await.map_err(status)?;
        Ok(Response::new(()))
    }

    async fn calibrate_camera(
        &self,
        request: Request<v1::CalibrateCameraRequest>,
    ) -> RpcResult<v1::CalibrateCameraResponse> {
        let owner = self.owner(&request);
        let (pairs, size) = pairs(request.into_inner());
        let work = move |stop: Stop| calibrate(&pairs, size, stop).map_err(uncalibrated);
        let found = owner.compute_as(JobKind::Calibration, work).await.map_err(status)?;
        Ok(Response::new(calibration(&found)))
    }
}
