//! Traces over the whole service: everything is logged and replayed, lists are filtered, expired ones are removed, disks fail.

use crate::harness::*;
use std::sync::Arc;
use std::time::Duration;
use tonic::Code;
use vrdp::api::v1;
use vrdp::engine::{AskedQuestion, Capacity, ClockReading, Engine, ModelSource, ModelSourceKind, Retention};
use vrdp::reason::AskOptions;

fn simulate(video: &str, seed: u64) -> v1::SimulateRequest {
    v1::SimulateRequest { video: video.into(), rollouts: Some(3), seed, ..Default::default() }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_trace_is_replayed_bit_for_bit_on_1_4_and_16_threads_and_after_a_restart() {
    let mut files = vec![];
    for workers in [1, 4, 16] {
        let folder = tempfile::tempdir().unwrap();
        let service = start(folder.path(), Capacity { workers, ..CAPACITY }).await;
        let video = service.create(video("small", 20)).await.unwrap();
        service.fit(&video).await.unwrap();
        let requests = [simulate(&video, 0), simulate(&video, 9)];
        for request in &requests {
            service.reasoning().simulate(request.clone()).await.unwrap();
        }
        let before = verified(&service).await;
        assert_eq!(before.len(), 3);
        service.stop().await;
        let service = start(folder.path(), Capacity { workers, ..CAPACITY }).await;
        for request in requests {
            service.reasoning().simulate(request).await.unwrap();
        }
        assert_eq!(verified(&service).await, before);
        service.stop().await;
        files.push(before);
    }
    assert!(files.iter().all(|f| *f == files[0]));
}

#[tokio::test(flavor = "multi_thread")]
async fn lists_are_filtered_by_video_model_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut models = vec![];
    for name in ["a", "b"] {
        let video = service.create(video(name, 20)).await.unwrap();
        models.push(service.reasoning().simulate(simulate(&video, 0)).await.unwrap().into_inner().model);
        service.reasoning().simulate(simulate(&video, 1)).await.unwrap();
    }
    let list = |request: v1::ListTracesRequest| {
        let mut client = service.traces();
        async move { client.list_traces(request).await.map(|r| r.into_inner().traces) }
    };
    let all = list(v1::ListTracesRequest::default()).await.unwrap();
    assert_eq!(all.len(), 6);
    let video = models[0].split("/models").next().unwrap().to_string();
    let of_video = list(v1::ListTracesRequest { video, ..Default::default() }).await.unwrap();
    let of_model = v1::ListTracesRequest { model: models[0].clone(), ..Default::default() };
    assert_eq!(list(of_model.clone()).await.unwrap(), of_video);
    assert!(of_video.len() == 3 && of_video.iter().all(|t| t.model == models[0]));
    let fits = of_video.iter().filter(|t| t.kind() == v1::TraceKind::Fit);
    assert_eq!(fits.count(), 1);
    let last = all.iter().filter_map(|t| t.store_time).max_by_key(|t| (t.seconds, t.nanos));
    let until = v1::ListTracesRequest { stored_before: last, ..Default::default() };
    let from = v1::ListTracesRequest { stored_from: last, ..Default::default() };
    let (until, from) = (list(until).await.unwrap(), list(from).await.unwrap());
    assert!(!from.is_empty() && until.len() + from.len() == 6 && from.iter().all(|t| !until.contains(t)));
    let wrong = v1::ListTracesRequest { model: "x".into(), page_size: -1, ..Default::default() };
    assert_eq!(fields(&list(wrong).await.unwrap_err()), ["model", "page_size"]);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trace_is_played_from_to_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("small", 20)).await.unwrap();
    let done = service.reasoning().simulate(simulate(&video, 0)).await.unwrap().into_inner();
    let play = |request: v1::ReplayTraceRequest| {
        let (mut client, name) = (service.traces(), done.trace.clone());
        async move {
            Ok::<_, tonic::Status>(
                client.replay_trace(v1::ReplayTraceRequest { name, ..request }).await?.into_inner(),
            )
        }
    };
    use v1::replay_trace_response::Item;
    let (mut frames, mut events) = (vec![], vec![]);
    let mut stream = play(v1::ReplayTraceRequest { speed: Some(0.0), ..Default::default() }).await.unwrap();
    while let Some(reply) = stream.message().await.unwrap() {
        match reply.item.unwrap() {
            Item::Frame(frame) => frames.push(frame),
            Item::Event(event) => events.push(event),
        }
    }
    assert_eq!((frames, events), (done.frames.clone(), done.events.clone()));
    let part = v1::ReplayTraceRequest {
        speed: Some(100.0),
        from: 0.2,
        to: Some(0.4),
        r#loop: true,
        ..Default::default()
    };
    let mut stream = play(part).await.unwrap();
    let mut seen = vec![];
    while seen.iter().filter(|round| **round == 2).count() < 6 {
        let reply = stream.message().await.unwrap().unwrap();
        assert!((0.2..=0.4).contains(&reply.time), "{}", reply.time);
        if matches!(reply.item, Some(Item::Frame(_))) {
            seen.push(reply.round);
        }
    }
    assert!(seen.is_sorted() && seen.iter().filter(|round| **round == 0).count() == 6, "{seen:?}");
    drop(stream);
    let wrong =
        v1::ReplayTraceRequest { speed: Some(f64::NAN), from: -1.0, to: Some(-2.0), ..Default::default() };
    assert_eq!(fields(&play(wrong).await.err().unwrap()), ["speed", "from", "to"]);
    let endless = v1::ReplayTraceRequest { speed: Some(0.0), r#loop: true, ..Default::default() };
    assert_eq!(fields(&play(endless).await.err().unwrap()), ["loop"]);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oldest_traces_go_first_and_none_that_is_read() {
    const DAY: Duration = Duration::from_secs(86_400);
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("small", 20)).await.unwrap();
    for seed in 0..4 {
        service.reasoning().simulate(simulate(&video, seed)).await.unwrap();
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert!(
        service.engine.remove_expired(ClockReading::now().after(1000 * DAY)).await.unwrap().is_empty(),
        "off by default"
    );
    service.stop().await;

    let open = |retention| Arc::new(Engine::open(folder.path(), CAPACITY).unwrap().with_retention(retention));
    let engine = open(Retention { max_bytes: Some(1), ..Retention::default() });
    let mut records = engine.traces(Default::default(), "", 99).await.unwrap();
    records.sort_by_key(|r| r.stored_ms);
    let mut read = engine.download(&records[1].id).await.unwrap();
    let removed = engine.remove_expired(ClockReading::now()).await.unwrap();
    let others = [0, 2, 3, 4].map(|k| records[k].id.clone());
    assert_eq!(removed, others, "oldest first");
    assert_eq!(read.next().await.unwrap().1.len() as u64, read.record().size_bytes.min(256 << 10));
    assert!(engine.trace(&records[0].id).await.is_err());
    drop((read, engine));

    let engine = open(Retention { max_age: Some(DAY), ..Retention::default() });
    let now = ClockReading::now();
    assert!(engine.remove_expired(now.after(DAY / 2)).await.unwrap().is_empty());
    assert_eq!(engine.remove_expired(now.after(DAY)).await.unwrap(), [records[1].id.clone()]);
    assert_eq!(std::fs::read_dir(folder.path().join("traces")).unwrap().count(), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_in_memory_names_no_trace_that_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let engine = Engine::open(folder.path(), CAPACITY).unwrap();
    let engine = Arc::new(engine.with_retention(Retention { max_bytes: Some(1), ..Retention::default() }));
    let scene = vrdp::api::scene_from_message(Some(video("small", 20))).unwrap();
    let (id, _) = engine.create_video(|_| Ok((scene, vec![]))).await.unwrap();
    let ask = || async {
        let question = vrdp::reason::Question::English {
            question: "Will the red cylinder collide with the blue cylinder?".into(),
            choices: vec![],
        };
        engine
            .ask(
                &id,
                &ModelSource { path: "", kind: ModelSourceKind::Default },
                AskedQuestion { question, conversation: Default::default(), lexicon: None },
                AskOptions { rollouts: 2, seed: 0 },
            )
            .await
            .unwrap()
    };
    let first = ask().await;
    assert!(engine.trace(&first.traces[0]).await.is_ok());
    assert!(Arc::ptr_eq(&first, &ask().await), "it is in memory");
    assert!(engine.remove_expired(ClockReading::now()).await.unwrap().contains(&first.traces[0]));
    let again = ask().await;
    assert_eq!(again.traces, first.traces);
    assert!(engine.trace(&again.traces[0]).await.is_ok(), "it was computed again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_file_is_not_handed_out_and_is_repaired_by_the_next_request() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("small", 20)).await.unwrap();
    let name = service.reasoning().simulate(simulate(&video, 0)).await.unwrap().into_inner().trace;
    let whole = download(&service, &name).await;
    let file = folder.path().join("traces").join(format!("{}.mcap", name.trim_start_matches("traces/")));
    let read = || async {
        let request = v1::DownloadTraceRequest { name: name.clone() };
        let mut stream = service.traces().download_trace(request).await?.into_inner();
        while stream.message().await?.is_some() {}
        Ok::<_, tonic::Status>(())
    };
    let replay = || async {
        let request = v1::ReplayTraceRequest { name: name.clone(), speed: Some(0.0), ..Default::default() };
        let mut stream = service.traces().replay_trace(request).await?.into_inner();
        while stream.message().await?.is_some() {}
        Ok::<_, tonic::Status>(())
    };
    let mut flipped = whole.clone();
    flipped.iter_mut().step_by(97).for_each(|byte| *byte ^= 1);
    for damaged in [&flipped[..], &whole[..whole.len() / 2]] {
        std::fs::write(&file, damaged).unwrap();
        for refused in [read().await, replay().await] {
            let refused = refused.unwrap_err();
            assert_eq!(refused.code(), Code::DataLoss, "{refused:?}");
            assert!(refused.message().contains("request its simulation again"), "{refused:?}");
        }
        service.reasoning().simulate(simulate(&video, 0)).await.unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), whole);
        read().await.unwrap();
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_fails_fails_the_request_with_the_reason_and_the_service_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("small", 20)).await.unwrap();
    let kept = service.reasoning().simulate(simulate(&video, 0)).await.unwrap().into_inner();
    let (traces, away) = (folder.path().join("traces"), folder.path().join("away"));
    // A test that runs as root may write into any folder, so the folder is replaced by a file.
    std::fs::rename(&traces, &away).unwrap();
    std::fs::write(&traces, b"").unwrap();
    let failed = service.reasoning().simulate(simulate(&video, 1)).await.unwrap_err();
    assert_eq!(failed.code(), Code::Unavailable, "{failed:?}");
    assert!(failed.message().contains("directory"), "{failed:?}");
    assert_eq!(service.reasoning().simulate(simulate(&video, 0)).await.unwrap().into_inner(), kept);
    std::fs::remove_file(&traces).unwrap();
    std::fs::rename(&away, &traces).unwrap();
    assert_eq!(verified(&service).await.len(), 2, "nothing of the failed request is listed");
    service.reasoning().simulate(simulate(&video, 1)).await.unwrap();
    assert_eq!(verified(&service).await.len(), 3);
    service.stop().await;
}
