//! Operations: long work that a cut connection, a caller who leaves and a restart do not lose.

use crate::harness::*;
use std::collections::BTreeSet;
use tonic::transport::Endpoint;
use tonic::{Code, Request, Status};
use v1::operation::Result as Outcome;
use v1::start_operation_request::Work;
use v1::{OperationKind, OperationState};
use vrdp::api::{Security, Tokens, v1};

fn fit_of(video: &str) -> Work {
    Work::FitModel(v1::FitModelRequest { parent: video.into(), ..Default::default() })
}

fn compare_of(video: &str) -> Work {
    let study = v1::StudyRequest { videos: vec![video.into()], ..Default::default() };
    Work::CompareModels(v1::CompareModelsRequest { study: Some(study), against: None })
}

async fn begin(service: &Running, work: Work) -> Result<v1::Operation, Status> {
    begin_named(service, work, "").await
}

async fn begin_named(service: &Running, work: Work, request_id: &str) -> Result<v1::Operation, Status> {
    let request = v1::StartOperationRequest { work: Some(work), request_id: request_id.into() };
    Ok(service.operations().start_operation(request).await?.into_inner())
}

async fn get(service: &Running, name: &str) -> Result<v1::Operation, Status> {
    let request = v1::GetOperationRequest { name: name.into() };
    Ok(service.operations().get_operation(request).await?.into_inner())
}

/// All that a waiting client sees.
async fn wait(service: &Running, name: &str) -> Vec<v1::Operation> {
    let request = v1::WaitOperationRequest { name: name.into() };
    let mut stream = service.operations().wait_operation(request).await.unwrap().into_inner();
    let mut seen = vec![];
    while let Some(operation) = stream.message().await.unwrap() {
        seen.push(operation);
    }
    seen
}

async fn done(service: &Running, name: &str) -> v1::Operation {
    wait(service, name).await.pop().unwrap()
}

async fn listed(service: &Running, request: v1::ListOperationsRequest) -> v1::ListOperationsResponse {
    service.operations().list_operations(request).await.unwrap().into_inner()
}

fn error_code(operation: &v1::Operation) -> Option<i32> {
    match &operation.result {
        Some(Outcome::Error(error)) => Some(error.code),
        _ => None,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn work_goes_on_when_the_connection_is_cut_and_its_result_is_fetched_later() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(fixture("scene_00022")).await.unwrap();
    let worker = service.occupy().await;
    let own = Endpoint::from_shared(service.url.clone()).unwrap().connect().await.unwrap();
    let mut client = OperationsClient::new(own);
    let request = v1::StartOperationRequest { work: Some(fit_of(&video)), request_id: "night run".into() };
    let started = client.start_operation(request.clone()).await.unwrap().into_inner();
    assert_eq!(
        (started.state(), started.done, started.kind()),
        (OperationState::Running, false, OperationKind::FitModel)
    );
    assert!(started.videos == [video.as_str()] && started.end_time.is_none(), "{started:?}");
    let waiting = v1::WaitOperationRequest { name: started.name.clone() };
    let mut stream = client.wait_operation(waiting).await.unwrap().into_inner();
    let first = stream.message().await.unwrap().unwrap();
    assert_eq!(first.progress.unwrap().phase(), v1::Phase::Waiting);
    // The connection goes with its last user.
    drop((stream, client, worker));

    let seen = wait(&service, &started.name).await;
    let ended = seen.last().unwrap();
    assert!(
        ended.done && ended.state() == OperationState::Succeeded && ended.progress.is_none(),
        "{ended:?}"
    );
    assert!(seen.iter().rev().skip(1).all(|o| !o.done && o.result.is_none() && o.progress.is_some()));
    assert!(ended.end_time.unwrap().seconds >= ended.create_time.unwrap().seconds);
    assert_eq!(ended.expire_time.unwrap().seconds - ended.end_time.unwrap().seconds, 7 * 24 * 3600);
    let Some(Outcome::Fitted(found)) = &ended.result else { panic!("{ended:?}") };
    assert_eq!(*found.model.as_ref().unwrap(), service.fit(&video).await.unwrap().1);
    assert_eq!(service.engine.fits_run(), 1, "the fit was computed once");
    assert_eq!(get(&service, &started.name).await.unwrap(), *ended);
    let again = service.operations().start_operation(request).await.unwrap().into_inner();
    assert_eq!(again, *ended, "a repeated start with the same id returns the first operation");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cancelled_operation_frees_its_thread_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(fixture("scene_00022")).await.unwrap();
    let worker = service.occupy().await;
    let started = begin(&service, fit_of(&video)).await.unwrap();
    assert_eq!(service.engine.jobs().len(), 1);
    let cancel = || v1::CancelOperationRequest { name: started.name.clone() };
    let cancelled = service.operations().cancel_operation(cancel()).await.unwrap().into_inner();
    assert_eq!((cancelled.state(), cancelled.done), (OperationState::Cancelled, true));
    assert_eq!(error_code(&cancelled), Some(Code::Cancelled as i32));
    assert!(service.engine.jobs().is_empty(), "its work has ended, too");
    drop(worker);
    assert_eq!(done(&service, &started.name).await, cancelled);
    let again = service.operations().cancel_operation(cancel()).await.unwrap().into_inner();
    assert_eq!(again, cancelled, "nothing is left to cancel");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_restart_results_are_there_and_what_ran_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let a = service.create(video("a", 20)).await.unwrap();
    let b = service.create(fixture("scene_00022")).await.unwrap();
    let finished = done(&service, &begin(&service, compare_of(&a)).await.unwrap().name).await;
    assert!(matches!(finished.result, Some(Outcome::Comparison(_))), "{finished:?}");
    // The only worker is busy until the service has ended.
    let worker = service.occupy().await;
    let cut = begin(&service, fit_of(&b)).await.unwrap();
    let waits = v1::WaitOperationRequest { name: cut.name.clone() };
    let mut waiting = service.operations().wait_operation(waits).await.unwrap().into_inner();
    let broken = tokio::spawn(async move {
        let _busy = worker;
        let mut last = None;
        loop {
            match waiting.message().await {
                Ok(Some(operation)) => last = Some(operation),
                Ok(None) => break Err(last),
                Err(status) => break Ok(status),
            }
        }
    });
    service.stop().await;
    let broken = broken.await.unwrap().expect("the stream does not end as if the operation had");
    assert_eq!(broken.code(), Code::Unavailable, "who waits may wait again");
    // A command that uses the folder for a moment starts nothing of it.
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_vrdp"));
    command.args(["operations", "list", "--data-dir"]).arg(folder.path()).env_remove("VRDP_SERVER");
    let shown = command.output().unwrap();
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("aborted") && !shown.contains("running"), "{shown}");

    let service = start(folder.path(), CAPACITY).await;
    assert_eq!(get(&service, &finished.name).await.unwrap(), finished);
    let resumed = done(&service, &cut.name).await;
    assert_eq!((resumed.state(), resumed.create_time), (OperationState::Succeeded, cut.create_time));
    assert!(matches!(resumed.result, Some(Outcome::Fitted(_))), "{resumed:?}");
    let only =
        v1::ListOperationsRequest { states: vec![OperationState::Succeeded.into()], ..Default::default() };
    assert_eq!(listed(&service, only).await.operations.len(), 2);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn operations_are_listed_in_pages_and_filtered() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let (a, b) =
        (service.create(video("a", 20)).await.unwrap(), service.create(video("b", 25)).await.unwrap());
    let mut names = vec![];
    for work in [fit_of(&a), compare_of(&a), fit_of(&b)] {
        let name = begin(&service, work).await.unwrap().name;
        assert_eq!(done(&service, &name).await.state(), OperationState::Succeeded);
        names.insert(0, name);
    }
    let mut pages = vec![];
    let mut request = v1::ListOperationsRequest { page_size: 2, ..Default::default() };
    loop {
        let page = listed(&service, request.clone()).await;
        pages.push(page.operations.into_iter().map(|o| o.name).collect::<Vec<_>>());
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    assert_eq!(pages, [names[..2].to_vec(), names[2..].to_vec()], "the newest first");
    let of = async |request| {
        listed(&service, request).await.operations.into_iter().map(|o| o.name).collect::<BTreeSet<_>>()
    };
    let set = |indices: &[usize]| indices.iter().map(|k| names[*k].clone()).collect::<BTreeSet<_>>();
    let empty = v1::ListOperationsRequest::default;
    let kind = OperationKind::FitModel.into();
    assert_eq!(of(v1::ListOperationsRequest { kinds: vec![kind], ..empty() }).await, set(&[0, 2]));
    assert_eq!(of(v1::ListOperationsRequest { video: a.clone(), ..empty() }).await, set(&[1, 2]));
    let both = v1::ListOperationsRequest { kinds: vec![kind], video: a.clone(), ..empty() };
    assert_eq!(of(both).await, set(&[2]));
    let running = vec![OperationState::Running.into()];
    assert_eq!(of(v1::ListOperationsRequest { states: running, ..empty() }).await, set(&[]));
    let wrong = v1::ListOperationsRequest {
        page_size: -1,
        page_token: "x".into(),
        states: vec![99],
        kinds: vec![1, 77],
        video: "b".into(),
    };
    let refused = service.operations().list_operations(wrong).await.unwrap_err();
    assert_eq!(fields(&refused), ["video", "states[0]", "kinds[1]", "page_size", "page_token"]);

    // Operations go with their video, or alone.
    service.videos().delete_video(v1::DeleteVideoRequest { name: a }).await.unwrap();
    assert_eq!(of(empty()).await, set(&[0]));
    let delete = || v1::DeleteOperationRequest { name: names[0].clone() };
    service.operations().delete_operation(delete()).await.unwrap();
    assert_eq!(of(empty()).await, set(&[]));
    assert_eq!(service.operations().delete_operation(delete()).await.unwrap_err().code(), Code::NotFound);
    assert!(service.fit(&b).await.is_ok() && service.engine.fits_run() == 2, "models stay");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_valid_starts_nothing_and_what_fails_keeps_its_error() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let empty = v1::StartOperationRequest { work: None, request_id: "x".repeat(129) };
    let refused = service.operations().start_operation(empty).await.unwrap_err();
    assert_eq!(fields(&refused), ["request_id", "work"]);
    assert_eq!(fields(&begin(&service, compare_of("nowhere")).await.unwrap_err()), ["study.videos[0]"]);
    assert_eq!(begin(&service, fit_of("videos/00")).await.unwrap_err().code(), Code::NotFound);
    let broken = v1::CreateVideoRequest { video: Some(video("", 0)), ..Default::default() };
    let broken = begin(&service, Work::CreateVideo(broken)).await.unwrap_err();
    assert!(!fields(&broken).is_empty(), "an import is refused like the call");
    assert_eq!(listed(&service, Default::default()).await.operations, []);
    assert_eq!(fields(&get(&service, "operations/X").await.unwrap_err()), ["name"]);
    assert_eq!(get(&service, "operations/00").await.unwrap_err().code(), Code::NotFound);

    let import = v1::CreateVideoRequest { video: Some(video("posted", 20)), ..Default::default() };
    let imported = done(&service, &begin(&service, Work::CreateVideo(import)).await.unwrap().name).await;
    let Some(Outcome::Video(posted)) = &imported.result else { panic!("{imported:?}") };
    assert!(posted.objects.len() == 3 && posted.objects.iter().all(|o| o.samples.is_empty()));
    assert!(imported.videos == [posted.name.as_str()]);

    let named = begin_named(&service, compare_of(&posted.name), "mine").await.unwrap();
    let other = begin_named(&service, fit_of(&posted.name), "mine").await.unwrap_err();
    assert_eq!(fields(&other), ["request_id"]);
    assert_eq!(begin_named(&service, compare_of(&posted.name), "mine").await.unwrap().name, named.name);
    assert_ne!(begin(&service, compare_of(&posted.name)).await.unwrap().name, named.name);

    // Two samples are a valid video, but too few to fit: the error of the call is that of the operation.
    let mut short = video("short", 2);
    short.objects.truncate(1);
    let short = service.create(short).await.unwrap();
    let worker = service.occupy().await;
    let started = begin(&service, fit_of(&short)).await.unwrap();
    drop(worker);
    let failed = done(&service, &started.name).await;
    let refused = service.fit(&short).await.unwrap_err();
    assert_eq!(refused.code(), Code::FailedPrecondition);
    assert_eq!((failed.state(), error_code(&failed)), (OperationState::Failed, Some(refused.code() as i32)));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn operations_of_another_tenant_do_not_exist() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = "secret-of-lab-a-00 = lab-a\nsecret-of-lab-b-00 = lab-b";
    let security = Security { tokens: Some(Tokens::parse(tokens).unwrap().into()), tls: None };
    let plain = |url| Endpoint::from_shared(url).unwrap();
    let service = start_secured(folder.path(), CAPACITY, security, plain).await;
    let post = v1::CreateVideoRequest { video: Some(video("mine", 20)), ..Default::default() };
    let begin = v1::StartOperationRequest { work: Some(Work::CreateVideo(post)), request_id: "same".into() };
    let start = async |lab| {
        service.operations().start_operation(of(lab, begin.clone())).await.unwrap().into_inner().name
    };
    let name = start("a").await;
    assert_ne!(name, start("b").await, "a request id is the tenant's own");
    let refused = [
        service
            .operations()
            .get_operation(of("b", v1::GetOperationRequest { name: name.clone() }))
            .await
            .err(),
        service
            .operations()
            .wait_operation(of("b", v1::WaitOperationRequest { name: name.clone() }))
            .await
            .err(),
        service
            .operations()
            .cancel_operation(of("b", v1::CancelOperationRequest { name: name.clone() }))
            .await
            .err(),
        service
            .operations()
            .delete_operation(of("b", v1::DeleteOperationRequest { name: name.clone() }))
            .await
            .err(),
    ];
    for status in refused {
        assert_eq!(status.unwrap().code(), Code::NotFound);
    }
    let list = service.operations().list_operations(of("b", v1::ListOperationsRequest::default())).await;
    assert_eq!(list.unwrap().into_inner().operations.len(), 1);
    service.operations().get_operation(of("a", v1::GetOperationRequest { name })).await.unwrap();
    service.stop().await;
}

fn of<T>(lab: &str, message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.metadata_mut().insert("authorization", format!("Bearer secret-of-lab-{lab}-00").parse().unwrap());
    request
}
