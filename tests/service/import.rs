//! A video file through `ImportVideo`: progress, then tracks that are stored; bad files are refused, and who leaves stops the work.

use crate::harness::*;
use tonic::Code;
use vrdp::api::v1::{self, import_video_request::Part, import_video_response::Event};

fn part(part: Part) -> v1::ImportVideoRequest {
    v1::ImportVideoRequest { part: Some(part) }
}

/// The parts of the committed video.
fn parts(bytes: &[u8]) -> Vec<v1::ImportVideoRequest> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/videos/scene_00011");
    let camera: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("camera.json")).unwrap()).unwrap();
    let rows = camera["camera_matrix"].as_array().unwrap().iter().take(3);
    let matrix = rows.flat_map(|row| row.as_array().unwrap()).filter_map(|v| v.as_f64()).collect();
    let camera = v1::Camera { matrix, image_width: 480.0, image_height: 320.0, ..Default::default() };
    let options =
        v1::ImportVideoOptions { display_name: "one".into(), camera: Some(camera), ..Default::default() };
    let data = bytes.chunks(10_000).map(|chunk| part(Part::Data(chunk.to_vec())));
    std::iter::once(part(Part::Options(options))).chain(data).collect()
}

fn file() -> Vec<u8> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/videos/scene_00011");
    std::fs::read(folder.join("video.mp4")).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_video_file_becomes_a_stored_video() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let reply = service.videos().import_video(tokio_stream::iter(parts(&file()))).await.unwrap();
    let mut replies = reply.into_inner();
    let (mut fractions, mut imported) = (vec![], None);
    while let Some(message) = replies.message().await.unwrap() {
        match message.event.unwrap() {
            Event::Progress(progress) => fractions.push(progress.fraction),
            Event::Imported(found) => imported = Some(found),
        }
    }
    assert!(!fractions.is_empty() && fractions.is_sorted(), "{fractions:?}");
    let v1::ImportedVideo { video, report } = imported.unwrap();
    let (video, report) = (video.unwrap(), report.unwrap());
    assert_eq!((video.display_name.as_str(), video.objects.len(), report.frames), ("one", 2, 128));
    assert_eq!(report.objects.len(), 2);
    let request = v1::GetVideoRequest { name: video.name.clone(), ..Default::default() };
    let kept = service.videos().get_video(request).await.unwrap().into_inner();
    assert_eq!(kept.objects, video.objects);
    // The same file gives the same video.
    let reply = service.videos().import_video(tokio_stream::iter(parts(&file()))).await.unwrap();
    let mut replies = reply.into_inner();
    let mut last = None;
    while let Some(message) = replies.message().await.unwrap() {
        last = message.event;
    }
    assert!(matches!(last, Some(Event::Imported(found)) if found.video.as_ref() == Some(&video)));
    service.stop().await;
}

/// The video that a file becomes.
async fn imported(service: &Running) -> v1::Video {
    let reply = service.videos().import_video(tokio_stream::iter(parts(&file()))).await.unwrap();
    let mut replies = reply.into_inner();
    while let Some(message) = replies.message().await.unwrap() {
        if let Some(Event::Imported(found)) = message.event {
            return found.video.unwrap();
        }
    }
    panic!("the stream ended without a video");
}

async fn got(service: &Running, name: &str) -> Result<v1::Video, tonic::Status> {
    let request = v1::GetVideoRequest { name: name.into(), ..Default::default() };
    Ok(service.videos().get_video(request).await?.into_inner())
}

#[tokio::test(flavor = "multi_thread")]
async fn stills_live_and_die_with_their_video() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = imported(&service).await;
    let kept = got(&service, &video.name).await.unwrap();
    let frames: Vec<u32> = kept.stills.iter().map(|s| s.frame).collect();
    assert!((frames.len(), frames[0], frames[11]) == (12, 0, 127) && frames.is_sorted(), "{frames:?}");
    for still in &kept.stills {
        assert_eq!((still.width, still.height), (480, 320));
        assert!(still.jpeg.starts_with(&[0xFF, 0xD8]) && still.jpeg.len() < 30_000, "{}", still.jpeg.len());
    }
    let listed = service.videos().list_videos(v1::ListVideosRequest::default()).await.unwrap().into_inner();
    assert!(listed.videos.len() == 1 && listed.videos[0].stills.is_empty() && video.stills.is_empty());
    // Posted again without stills it keeps those that it has: they are no part of its name.
    let bare = v1::Video { stills: vec![], ..kept.clone() };
    assert_eq!(service.create(bare.clone()).await.unwrap(), video.name);
    assert_eq!(got(&service, &video.name).await.unwrap().stills, kept.stills);
    let request = v1::DeleteVideoRequest { name: video.name.clone() };
    service.videos().delete_video(request).await.unwrap();
    assert_eq!(got(&service, &video.name).await.unwrap_err().code(), Code::NotFound);
    service.create(bare.clone()).await.unwrap();
    assert!(got(&service, &video.name).await.unwrap().stills.is_empty());
    let some = kept.stills[2..4].to_vec();
    service.create(v1::Video { stills: some.clone(), ..bare }).await.unwrap();
    assert_eq!(got(&service, &video.name).await.unwrap().stills, some);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn stills_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = imported(&service).await;
    let kept = got(&service, &video.name).await.unwrap();
    let refused = async |change: &dyn Fn(&mut v1::Video)| {
        let mut other = kept.clone();
        change(&mut other);
        fields(&service.create(other).await.unwrap_err())
    };
    assert_eq!(refused(&|v| v.stills.push(v.stills[11].clone())).await, ["video.stills"]);
    assert_eq!(refused(&|v| v.stills[4].frame = 3).await, ["video.stills[4].frame"]);
    assert_eq!(refused(&|v| v.stills[11].frame = 128).await, ["video.stills[11].frame"]);
    assert_eq!(refused(&|v| v.stills[0].jpeg = b"GIF89a".to_vec()).await, ["video.stills[0].jpeg"]);
    assert_eq!(refused(&|v| v.stills[1].jpeg.truncate(500)).await, ["video.stills[1].jpeg"]);
    assert_eq!(refused(&|v| v.stills[1].jpeg.resize((64 << 10) + 1, 0)).await, ["video.stills[1].jpeg"]);
    // A frame of another size is neither the camera's nor the picture's.
    assert_eq!(
        refused(&|v| v.stills[2].width = 640).await,
        ["video.stills[2].width", "video.stills[2].jpeg"]
    );
    // All at once, with those of the scene.
    let both = refused(&|v| (v.fps, v.stills[0].jpeg) = (-1.0, vec![])).await;
    assert_eq!(both, ["video.fps", "video.stills[0].jpeg"]);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_report_of_a_video_file_shows_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = imported(&service).await;
    let study = Some(v1::StudyRequest { videos: vec![video.name], ..Default::default() });
    let request = v1::WriteReportRequest { study, as_is: true, ..Default::default() };
    let mut stream = service.models().write_report(request).await.unwrap().into_inner();
    let mut written = None;
    while let Some(message) = stream.message().await.unwrap() {
        if let Some(v1::write_report_response::Event::Report(report)) = message.event {
            written = Some(report);
        }
    }
    let report = written.unwrap();
    assert_eq!(report.html.matches("<image href=\"data:image/jpeg;base64,").count(), 12);
    assert!(report.html.contains("What was seen") && report.html.contains("class=\"seen outline\""));
    assert!(report.html.len() < 1 << 20, "{}", report.html.len());
    assert!(report.pictures.iter().any(|p| p.name == "still-1-12.svg" && p.svg.contains("data:image/jpeg")));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trace_shows_stills_where_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = imported(&service).await.name;
    let mut counts = vec![];
    for stills in [false, true] {
        let request =
            v1::SimulateRequest { video: video.clone(), rollouts: Some(0), stills, ..Default::default() };
        let done = service.reasoning().simulate(request).await.unwrap().into_inner();
        let read = vrdp::recording::read(&download(&service, &done.trace).await).unwrap();
        counts.push(["/camera/image", "/camera/annotations"].map(|t| read.counts.get(t).copied()));
    }
    assert_eq!(counts, [[None, None], [Some(12), Some(12)]]);
    assert_eq!(verified(&service).await.len(), 3);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_is_no_video_is_refused_with_the_cure() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let refused = async |bytes: &[u8]| {
        let reply = service.videos().import_video(tokio_stream::iter(parts(bytes))).await;
        match reply {
            Err(status) => status,
            Ok(reply) => {
                let mut replies = reply.into_inner();
                loop {
                    match replies.message().await {
                        Err(status) => break status,
                        Ok(Some(_)) => {}
                        Ok(None) => panic!("it was taken"),
                    }
                }
            }
        }
    };
    let whole = file();
    for bytes in [&b""[..], b"id,t,x,y\n", &whole[..whole.len() / 2]] {
        let status = refused(bytes).await;
        assert_eq!(
            (status.code(), fields(&status)),
            (Code::InvalidArgument, vec!["data".to_string()]),
            "{status}"
        );
    }
    service.stop().await;
}
