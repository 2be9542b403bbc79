//! `ImportVideo`: the parts of a file in, progress and tracks out.

use super::{RpcResult, RpcStream};
use crate::api::convert::ingest::video_file;
use crate::api::convert::progress::progress_message;
use crate::api::convert::video::video_message;
use crate::api::convert::violations::check_request_id;
use crate::api::server::byte_budget::{ByteBudget, HeldBytes, Holder};
use crate::api::status::status;
use crate::api::v1;
use crate::engine::{Engine, EngineError, JobProgress};
use crate::media::MAX_VIDEO_BYTES;
use crate::perception::PerceptionOptions;
use futures_util::stream::StreamExt;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::{Response, Status, Streaming};
use v1::import_video_request::Part;
use v1::import_video_response::Event;

/// Largest picture of the ground (bytes).
const MAX_BACKGROUND: usize = 4 << 20;
/// Replies that wait for a slow reader; progress beyond it is dropped.
const WAITING: usize = 4;

/// A file as it came, and what is known of it.
struct GivenFile {
    bytes: Vec<u8>,
    options: (Option<String>, PerceptionOptions),
    request_id: String,
    /// Of its bytes.
    held: HeldBytes,
}

/// Where the bytes of a file are counted, and for whom.
pub struct ImportRoom {
    pub budget: ByteBudget,
    pub holder: Holder,
}

pub async fn import_video(
    owner: Arc<Engine>,
    parts: Streaming<v1::ImportVideoRequest>,
    room: ImportRoom,
) -> RpcResult<RpcStream<v1::ImportVideoResponse>> {
    let file = received(parts, room).await?;
    let (sender, receiver) = mpsc::channel(WAITING);
    let token = CancellationToken::new();
    let stopped = token.clone().drop_guard();
    tokio::spawn(async move {
        let reply = perceived(&owner, file, token, sender.clone()).await.map_err(status);
        // The caller may have left.
        let _ = sender.send(reply).await;
    });
    let replies = ReceiverStream::new(receiver).map(move |reply| {
        let _stops_the_work_when_the_caller_leaves = &stopped;
        reply
    });
    Ok(Response::new(replies.boxed()))
}

async fn received(
    mut parts: Streaming<v1::ImportVideoRequest>,
    room: ImportRoom,
) -> Result<GivenFile, Status> {
    let (mut options, mut bytes, mut background) = (None, vec![], vec![]);
    let held = HeldBytes::default();
    let hold = |part: &[u8]| -> Result<(), Status> {
        held.add(room.budget.reserve(&room.holder, part.len())?);
        Ok(())
    };
    while let Some(message) = parts.message().await? {
        let (place, most) = match message.part {
            Some(Part::Options(given)) => {
                options = Some(given);
                continue;
            }
            Some(Part::Data(part)) => {
                hold(&part)?;
                bytes.extend(part);
                (("data", bytes.len()), MAX_VIDEO_BYTES)
            }
            Some(Part::Background(part)) => {
                hold(&part)?;
                background.extend(part);
                (("background", background.len()), MAX_BACKGROUND)
            }
            None => continue,
        };
        if place.1 > most {
            let message = format!("has more than {most} bytes; cut or compress it");
            return Err(status(EngineError::invalid(place.0, message)));
        }
    }
    let given = options.unwrap_or_default();
    check_request_id(&given.request_id).map_err(status)?;
    let request_id = given.request_id.clone();
    let options = video_file::options(given, &background).map_err(status)?;
    Ok(GivenFile { bytes, options, request_id, held })
}

async fn perceived(
    owner: &Engine,
    file: GivenFile,
    token: CancellationToken,
    sender: mpsc::Sender<Result<v1::ImportVideoResponse, Status>>,
) -> Result<v1::ImportVideoResponse, EngineError> {
    let at = Mutex::new(JobProgress::default());
    let report = Arc::new(move |report| {
        let mut at = at.lock().unwrap_or_else(PoisonError::into_inner);
        if at.update(report) {
            let event = Some(Event::Progress(progress_message(&at)));
            let _ = sender.try_send(Ok(v1::ImportVideoResponse { event }));
        }
    });
    let _held = file.held;
    let (id, scene, report) = owner.import_video(file.bytes, file.options, token, report).await?;
    tracing::info!(video = id, request_id = file.request_id, "video imported");
    let video = Some(video_message(&id, &scene, true));
    let report = Some(video_file::report_message(&report));
    Ok(v1::ImportVideoResponse { event: Some(Event::Imported(v1::ImportedVideo { video, report })) })
}
