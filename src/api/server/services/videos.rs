//! The service `Videos`.

use super::{RpcResult, Services, cut_page};
use crate::api::convert::camera::{calibration, pairs, uncalibrated};
use crate::api::convert::detections::linking_message;
use crate::api::convert::new_video::scene_from_request;
use crate::api::convert::video::video_message;
use crate::api::convert::violations::{page, video_id};
use crate::api::status::status;
use crate::api::v1;
use crate::scene::calibrate;
use std::sync::{Arc, OnceLock};
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::videos_server::Videos for Services {
    async fn create_video(&self, request: Request<v1::CreateVideoRequest>) -> RpcResult<v1::Video> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let request_id = given.request_id.clone();
        let linking = Arc::new(OnceLock::new());
        let report_to = linking.clone();
        let make = move || {
            let (scene, report) = scene_from_request(given)?;
            // The closure runs once, so the cell is empty.
            let _ = report_to.set(report);
            Ok(scene)
        };
        let (id, scene) = owner.create_video(make).await.map_err(status)?;
        tracing::info!(video = id, request_id, "video created");
        let linking = linking.get().and_then(|r| r.as_ref()).map(linking_message);
        Ok(Response::new(v1::Video { linking, ..video_message(&id, &scene, true) }))
    }

    async fn get_video(&self, request: Request<v1::GetVideoRequest>) -> RpcResult<v1::Video> {
        let owner = self.owner(&request);
        let id = video_id("name", &request.into_inner().name).map_err(status)?;
        let scene = owner.video(&id).await.map_err(status)?;
        Ok(Response::new(video_message(&id, &scene, true)))
    }

    async fn list_videos(
        &self,
        request: Request<v1::ListVideosRequest>,
    ) -> RpcResult<v1::ListVideosResponse> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let (size, after) = page(given.page_size, given.page_token).map_err(status)?;
        let mut rows = owner.videos(&after, size + 1).await.map_err(status)?;
        let next_page_token = cut_page(&mut rows, size, |(id, _)| id);
        let videos = rows.iter().map(|(id, scene)| video_message(id, scene, false)).collect();
        Ok(Response::new(v1::ListVideosResponse { videos, next_page_token }))
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
        let work = move || calibrate(&pairs, size).map_err(uncalibrated);
        let found = owner.compute(work).await.map_err(status)?;
        Ok(Response::new(calibration(&found)))
    }
}
