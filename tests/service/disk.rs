//! A disk on which any write may fail.

use crate::endure::{Acknowledged, Program, count, whole};
use crate::harness::*;
use std::path::Path;
use tonic::Code;
use tonic::transport::Channel;
use vrdp::api::v1;

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        let kind = entry.file_type().unwrap();
        if kind.is_dir() {
            copy(&entry.path(), &target);
        } else if kind.is_file() {
            // A killed program leaves its socket.
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Posts and simulates until a write fails; returns the error.
async fn fill(channel: &Channel, acknowledged: &mut Acknowledged) -> Option<tonic::Status> {
    for k in 0..40 {
        let posted = v1::Video { fps: 20.0 + f64::from(k), ..video("crammed", 200) };
        let request = v1::CreateVideoRequest { video: Some(posted), ..Default::default() };
        let name = match VideosClient::new(channel.clone()).create_video(request).await {
            Ok(reply) => reply.into_inner().name,
            Err(status) => return Some(status),
        };
        acknowledged.videos.insert(name.clone());
        match simulate(channel, &name).await {
            Ok(done) => {
                acknowledged.models.insert(done.model);
                acknowledged.traces.insert(done.trace);
            }
            Err(status) => return Some(status),
        }
    }
    None
}

#[tokio::test(flavor = "multi_thread")]
async fn whichever_write_fails_nothing_partial_is_left() {
    let steps = count(100, 5) as u64;
    let folder = tempfile::tempdir().unwrap();
    let sound = folder.path().join("sound");
    let (first, kept) = {
        let program = Program::start(&sound);
        let channel = program.channel().await;
        let request = v1::CreateVideoRequest { video: Some(video("first", 20)), ..Default::default() };
        let name = VideosClient::new(channel.clone()).create_video(request).await.unwrap().into_inner().name;
        let kept = simulate(&channel, &name).await.unwrap();
        (name, kept)
    };
    let database = std::fs::metadata(sound.join("vrdp.redb")).unwrap().len() / 512;
    let (mut started, mut failed) = (0, 0);
    for step in 0..steps {
        // Limits from "nothing fits" to "the database may double".
        let blocks = 2 * database * step / steps;
        let data = folder.path().join(format!("cramped {step}"));
        copy(&sound, &data);
        let mut acknowledged = Acknowledged::default();
        acknowledged.videos.insert(first.clone());
        acknowledged.models.insert(kept.model.clone());
        acknowledged.traces.insert(kept.trace.clone());
        if let Some(program) = Program::start_cramped(&data, blocks) {
            started += 1;
            let channel = program.channel().await;
            if let Some(status) = fill(&channel, &mut acknowledged).await {
                failed += 1;
                assert_eq!(status.code(), Code::Unavailable, "{blocks} blocks: {status:?}");
                assert!(status.message().contains("data folder"), "{status:?}");
            }
            // Stored results can still be read.
            let get = v1::GetVideoRequest { name: first.clone(), ..Default::default() };
            VideosClient::new(channel.clone()).get_video(get).await.unwrap();
        }
        let program = Program::start(&data);
        let channel = program.channel().await;
        whole(&channel, &acknowledged).await;
        assert_eq!(simulate(&channel, &first).await.unwrap(), kept);
        std::fs::remove_dir_all(&data).unwrap();
    }
    assert!(failed > 0, "no write failed");
    println!(
        "{steps} sizes of the disk: it started on {started}, a write failed on {failed}, nothing is missing"
    );
}
