//! Discoveries that the end of a service cuts short.

use crate::discover::{post, request};
use crate::endure::{count, is_long};
use crate::harness::*;
use crate::process::BothPorts;
use std::path::Path;
use std::time::{Duration, Instant};
use tonic::transport::{Channel, Endpoint};
use v1::operation::Result as Outcome;
use v1::start_operation_request::Work;
use vrdp::api::v1;

async fn connected(program: &BothPorts) -> OperationsClient<Channel> {
    let endpoint = Endpoint::from_shared(format!("http://{}", program.grpc)).unwrap();
    OperationsClient::new(endpoint.connect().await.unwrap()).max_decoding_message_size(64 << 20)
}

async fn started(program: &BothPorts, videos: &[String]) -> String {
    let work = Some(Work::DiscoverEffects(request(videos)));
    let request = v1::StartOperationRequest { work, request_id: String::new() };
    connected(program).await.start_operation(request).await.unwrap().into_inner().name
}

/// Waits until the operation has ended, or until `is_far` of its fraction and of the time since the call.
async fn found_before(
    program: &BothPorts,
    name: &str,
    is_far: impl Fn(f64, Duration) -> bool,
) -> Option<v1::Discovery> {
    let start = Instant::now();
    let request = v1::WaitOperationRequest { name: name.into() };
    let mut stream = connected(program).await.wait_operation(request).await.unwrap().into_inner();
    let (mut last, mut fraction) = (None, 0.0);
    loop {
        match tokio::time::timeout(Duration::from_millis(100), stream.message()).await {
            Ok(update) => match update.unwrap() {
                Some(operation) => {
                    fraction = operation.progress.map_or(fraction, |p: v1::Progress| p.fraction);
                    last = Some(operation);
                }
                None => break,
            },
            Err(_) if is_far(fraction, start.elapsed()) => return None,
            Err(_) => {}
        }
    }
    match last.unwrap().result {
        Some(Outcome::Discovery(found)) => Some(found),
        other => panic!("{other:?}"),
    }
}

/// A folder with the videos of a group; their names.
async fn posted(folder: &Path) -> Vec<String> {
    let service = start(folder, CAPACITY).await;
    let videos = post(&service, "bullet_coriolis_medium").await;
    service.stop().await;
    videos
}

/// With VRDP_LONG_TESTS=1, 20 restarts, and what CPU time each of them has cost.
#[tokio::test(flavor = "multi_thread")]
async fn a_discovery_goes_on_from_its_steps_after_a_kill() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [whole, cut] = [&folders[0], &folders[1]].map(|f| f.path());
    let videos = posted(whole).await;
    assert_eq!(posted(cut).await, videos);
    let never = |_: f64, _: Duration| false;
    let program = BothPorts::start(whole, &[]);
    let name = started(&program, &videos).await;
    let expected = found_before(&program, &name, never).await.unwrap();
    let alone = program.cpu();
    drop(program);

    let mut program = BothPorts::start(cut, &[]);
    let name = started(&program, &videos).await;
    let restarts = count(20, 1);
    // Behind the search and the first write; or every four seconds.
    let is_far = |fraction: f64, time: Duration| match is_long() {
        true => time > Duration::from_secs(4),
        false => fraction > 0.35 && time > Duration::from_millis(2500),
    };
    let (mut found, mut used, mut done) = (None, Duration::ZERO, 0);
    for k in 0..restarts {
        found = found_before(&program, &name, is_far).await;
        if found.is_some() {
            break;
        }
        used += program.cpu();
        // Every other one is drained; a kill is the harder case.
        program.signal(if k % 2 == 0 { "KILL" } else { "TERM" });
        program.ended();
        program = BothPorts::start(cut, &[]);
        done += 1;
        if !is_long() {
            program.logged("a discovery goes on from what was kept of it");
        }
    }
    let found = match found {
        Some(found) => found,
        None => found_before(&program, &name, never).await.unwrap(),
    };
    used += program.cpu();
    assert!(done > 0, "it ended before the first kill");
    // Everything but the names of traces, which are random.
    assert_eq!(
        (found.verdict, &found.effects, &found.revisions),
        (expected.verdict, &expected.effects, &expected.revisions)
    );
    let lost = (used.saturating_sub(alone)).as_secs_f64() / f64::from(done);
    println!("{done} restarts; {:.1} s of CPU alone, {lost:.1} s lost at each", alone.as_secs_f64());
    assert!(!is_long() || lost < 10.0);
}
