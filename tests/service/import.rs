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
