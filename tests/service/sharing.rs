//! Concurrent callers: one fit for all, a caller who leaves, a full queue.

use crate::harness::*;
use std::time::Duration;
use tonic::Code;
use tonic_types::StatusExt;
use vrdp::api::v1;
use vrdp::engine::Capacity;

#[tokio::test(flavor = "multi_thread")]
async fn equal_requests_share_one_fit_though_the_first_caller_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(fixture("scene_00022")).await.unwrap();
    let request = v1::FitModelRequest { parent: video.clone(), ..Default::default() };
    let worker = service.occupy().await;
    let first = service.models().fit_model(request.clone()).await.unwrap();
    let mut others = Vec::new();
    for _ in 0..20 {
        others.push(service.models().fit_model(request.clone()).await.unwrap().into_inner());
    }
    drop((first, worker));
    let mut models = Vec::new();
    for mut stream in others {
        while let Some(message) = stream.message().await.unwrap() {
            if let Some(v1::fit_model_response::Event::Model(model)) = message.event {
                models.push(model);
            }
        }
    }
    assert_eq!(models.len(), 20);
    assert!(models.iter().all(|m| *m == models[0]));
    assert_eq!(service.engine.fits_run(), 1);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_queue_refuses_with_advice_and_recovers_when_the_caller_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let capacity = Capacity { workers: 1, queue: 0, ..CAPACITY };
    let service = start(folder.path(), capacity).await;
    let big = service.create(fixture("scene_00022")).await.unwrap();
    let small = service.create(video("small", 20)).await.unwrap();
    let request = v1::FitModelRequest { parent: big, ..Default::default() };
    let worker = service.occupy().await;
    let refused = service.fit(&small).await.unwrap_err();
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused:?}");
    assert!(refused.get_details_retry_info().unwrap().retry_delay.unwrap() > Duration::ZERO);
    assert_eq!(refused.metadata().get("grpc-retry-pushback-ms").unwrap(), "1000");
    drop(worker);
    // The slot is free when the job has ended, which takes a moment; until then a call may be refused.
    let mut left = loop {
        let refused = match service.models().fit_model(request.clone()).await {
            Err(status) => status,
            Ok(response) => {
                let mut stream = response.into_inner();
                match stream.message().await {
                    Ok(_) => break stream,
                    Err(status) => status,
                }
            }
        };
        assert_eq!(refused.code(), Code::ResourceExhausted, "{refused:?}");
    };
    // Here too, when the abandoned fit has noticed its cancellation.
    assert!(left.message().await.is_ok());
    drop(left);
    while let Err(status) = service.fit(&small).await {
        assert_eq!(status.code(), Code::ResourceExhausted, "{status:?}");
        tokio::task::yield_now().await;
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn work_past_its_deadline_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let name = service.create(video("late", 20)).await.unwrap();
    service.stop().await;
    let service = start(folder.path(), Capacity { job_timeout: Duration::ZERO, ..CAPACITY }).await;
    assert_eq!(service.fit(&name).await.unwrap_err().code(), Code::DeadlineExceeded);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn slow_work_reports_progress_and_ends_at_its_deadline() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), Capacity { job_timeout: Duration::from_secs(3), ..CAPACITY }).await;
    let name = service.create(video("slow", 20)).await.unwrap();
    let worker = service.occupy().await;
    let request = v1::FitModelRequest { parent: name, ..Default::default() };
    let mut stream = service.models().fit_model(request).await.unwrap().into_inner();
    let mut messages = 0;
    let end = loop {
        match stream.message().await {
            Ok(_) => messages += 1,
            Err(status) => break status,
        }
    };
    assert_eq!(end.code(), Code::DeadlineExceeded, "{end:?}");
    assert!(messages >= 2, "{messages} messages in three seconds");
    drop(worker);
    service.stop().await;
}
