//! Discoveries that the end of a service cuts short.

use crate::discover::{post, request};
use crate::endure::{count, is_long};
use crate::harness::*;
use crate::process::BothPorts;
use std::path::Path;
use std::time::Duration;
use tonic::transport::{Channel, Endpoint};
use v1::operation::Result as Outcome;
use v1::start_operation_request::Work;
use vrdp::api::v1;

async fn connected(program: &BothPorts) -> OperationsClient<Channel> {
    let endpoint = Endpoint::from_shared(format!("http://{}", program.grpc)).unwrap();
    OperationsClient::new(endpoint.connect().await.unwrap()).max_decoding_message_size(64 << 20)
}

async fn begun(program: &BothPorts, videos: &[String]) -> String {
    let work = Some(Work::DiscoverEffects(request(videos)));
    let request = v1::StartOperationRequest { work, request_id: String::new() };
    connected(program).await.start_operation(request).await.unwrap().into_inner().name
}

/// Waits until the operation has ended or `most` is over.
async fn found_within(program: &BothPorts, name: &str, most: Duration) -> Option<v1::Discovery> {
    let waiting = async {
        let request = v1::WaitOperationRequest { name: name.into() };
        let mut stream = connected(program).await.wait_operation(request).await.unwrap().into_inner();
        let mut last = None;
        while let Some(operation) = stream.message().await.unwrap() {
            last = Some(operation);
        }
        match last.unwrap().result {
            Some(Outcome::Discovery(found)) => found,
            other => panic!("{other:?}"),
        }
    };
    tokio::time::timeout(most, waiting).await.ok()
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
    let program = BothPorts::start(whole, &[]);
    let name = begun(&program, &videos).await;
    let expected = found_within(&program, &name, Duration::MAX).await.unwrap();
    let alone = program.cpu();
    drop(program);

    let mut program = BothPorts::start(cut, &[]);
    let name = begun(&program, &videos).await;
    let restarts = count(20, 1);
    // In the middle, on two CPU threads; or as often as it keeps some.
    let slice = if is_long() { Duration::from_secs(4) } else { alone / 4 };
    let (mut found, mut used, mut done) = (None, Duration::ZERO, 0);
    for k in 0..restarts {
        found = found_within(&program, &name, slice).await;
        if found.is_some() {
            break;
        }
        used += program.cpu();
        // Every other one is drained; a kill is the harder case.
        program.signal(if k % 2 == 0 { "KILL" } else { "TERM" });
        program.ended();
        program = BothPorts::start(cut, &[]);
        program.logged("a discovery goes on from what was kept of it");
        done += 1;
    }
    let found = match found {
        Some(found) => found,
        None => found_within(&program, &name, Duration::MAX).await.unwrap(),
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
