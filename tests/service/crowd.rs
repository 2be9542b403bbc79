//! Hostile or overloading clients, and what a well-behaved client notices of them.

use crate::endure::{Program, count, is_long};
use crate::harness::*;
use h2::client::{ResponseFuture, SendRequest};
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tonic::Code;
use tonic::transport::Channel;
use vrdp::api::v1;

/// A connection on which a test can send any frame.
async fn raw(program: &Program) -> SendRequest<bytes::Bytes> {
    let stream = TcpStream::connect(program.address()).await.unwrap();
    let (sender, connection) = h2::client::handshake(stream).await.unwrap();
    tokio::spawn(async move {
        // The service may close it: the test provokes that.
        let _ = connection.await;
    });
    sender
}

fn call(path: &str) -> http::request::Builder {
    let uri = format!("http://vrdp{path}");
    http::Request::post(uri).header("content-type", "application/grpc").header("te", "trailers")
}

async fn honest(channel: &Channel) {
    let request = v1::ListVideosRequest::default();
    VideosClient::new(channel.clone()).list_videos(request).await.unwrap();
}

/// Growth of the program's memory (MiB).
fn grown(program: &Program, before: f64) -> f64 {
    program.resident() - before
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_that_are_reset_at_once_cost_nothing() {
    let resets = count(100_000, 2_000);
    let folder = tempfile::tempdir().unwrap();
    let program = Program::start(folder.path());
    let channel = program.channel().await;
    honest(&channel).await;
    let before = program.resident();
    let (mut sent, mut connections) = (0, 0);
    while sent < resets {
        connections += 1;
        let Ok(mut sender) = raw(&program).await.ready().await else { continue };
        while sent < resets {
            let Ok(ready) = sender.ready().await else { break };
            sender = ready;
            let request = call("/vrdp.v1.Videos/ListVideos").body(()).unwrap();
            let Ok((_, mut stream)) = sender.send_request(request, false) else { break };
            stream.send_reset(h2::Reason::CANCEL);
            sent += 1;
        }
    }
    honest(&channel).await;
    let grown = grown(&program, before);
    assert!(grown < 50.0, "{grown} MiB more");
    println!("{sent} resets over {connections} connections: {grown:.1} MiB more");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_inflates_and_what_is_too_large_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let program = Program::start(folder.path());
    let channel = program.channel().await;
    let before = program.resident();
    let refused = async |encoding: &str, head: [u8; 5], body: usize| -> Code {
        let mut sender = raw(&program).await.ready().await.unwrap();
        let request = call("/vrdp.v1.Videos/CreateVideo").header("grpc-encoding", encoding).body(()).unwrap();
        let (reply, mut stream): (ResponseFuture, _) = sender.send_request(request, false).unwrap();
        stream.send_data(head.to_vec().into(), body == 0).unwrap();
        let mut left = body;
        while left > 0 {
            let part = left.min(16_000);
            left -= part;
            if stream.send_data(vec![0; part].into(), left == 0).is_err() {
                break;
            }
        }
        let reply = reply.await.unwrap();
        let code =
            |headers: &http::HeaderMap| headers.get("grpc-status").map(|v| v.to_str().unwrap().to_string());
        let status = match code(reply.headers()) {
            Some(status) => status,
            None => code(&reply.into_body().trailers().await.unwrap().unwrap()).unwrap(),
        };
        Code::from_bytes(status.as_bytes())
    };
    // A message that is marked as compressed is refused without decompression.
    assert_eq!(refused("gzip", [1, 0, 0, 39, 16], 10_000).await, Code::Unimplemented);
    // A message one byte above the limit is refused before its body is read.
    let [a, b, c, d] = ((16u32 << 20) + 1).to_be_bytes();
    assert_eq!(refused("identity", [0, a, b, c, d], 0).await, Code::OutOfRange);
    honest(&channel).await;
    assert!(grown(&program, before) < 50.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn who_says_nothing_takes_nobodys_place() {
    let strangers = count(1_000, 400);
    let folder = tempfile::tempdir().unwrap();
    let program = Program::start(folder.path());
    let channel = program.channel().await;
    let before = program.resident();
    let mut idle = vec![];
    for k in 0..strangers {
        let mut stream = TcpStream::connect(program.address()).await.unwrap();
        if k % 2 == 0 {
            // Half of the first bytes.
            let _ = stream.write_all(b"PRI * HT").await;
        }
        idle.push(stream);
    }
    honest(&channel).await;
    honest(&program.channel().await).await;
    let grown = grown(&program, before);
    assert!(grown < 50.0, "{grown} MiB more");
    // The oldest connections were closed.
    let mut byte = [0];
    let gone = tokio::time::timeout(Duration::from_secs(60), idle[1].peek(&mut byte)).await;
    assert!(matches!(gone, Ok(Ok(0) | Err(_))), "{gone:?}");
    println!("{strangers} connections that say nothing: {grown:.1} MiB more");
}

/// Latencies (s) of completed and of refused calls.
#[derive(Default)]
struct Served {
    done: Vec<f64>,
    refused: Vec<f64>,
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values
        .get(((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1)))
        .copied()
        .unwrap_or(0.0)
}

/// A simulation that is not in the cache.
async fn simulate(channel: Channel, video: String, seed: u64) -> (f64, Result<(), Code>) {
    let began = Instant::now();
    let request = v1::SimulateRequest { video, seed, rollouts: Some(16), ..Default::default() };
    let reply = ReasoningClient::new(channel).max_decoding_message_size(64 << 20).simulate(request).await;
    (began.elapsed().as_secs_f64(), reply.map(|_| ()).map_err(|status| status.code()))
}

/// Sends `rate` simulations a second without waiting for replies.
async fn offer(channels: &[Channel], video: &str, rate: f64, time: Duration, seed: u64) -> Served {
    let began = Instant::now();
    let mut calls = tokio::task::JoinSet::new();
    for k in 0.. {
        let due = began + Duration::from_secs_f64(k as f64 / rate);
        if due > began + time {
            break;
        }
        tokio::time::sleep_until(due.into()).await;
        let channel = channels[k as usize % channels.len()].clone();
        calls.spawn(simulate(channel, video.to_string(), seed + k));
    }
    let mut served = Served::default();
    while let Some(call) = calls.join_next().await {
        match call.unwrap() {
            (seconds, Ok(())) => served.done.push(seconds),
            (seconds, Err(Code::ResourceExhausted)) => served.refused.push(seconds),
            (_, Err(code)) => panic!("{code:?}"),
        }
    }
    served
}

/// Ten times the capacity of the program, from clients that do not wait.
async fn overload(data: &Path, queue: &str) {
    let time = Duration::from_secs(count(60, 2) as u64);
    let program = Program::start_with(data, &[("VRDP_WORKERS", "1"), ("VRDP_QUEUE", queue)]);
    let channels =
        [program.channel().await, program.channel().await, program.channel().await, program.channel().await];
    let created = v1::CreateVideoRequest { video: Some(fixture("scene_00000")), ..Default::default() };
    let video = VideosClient::new(channels[0].clone()).create_video(created).await.unwrap().into_inner().name;
    let mut alone = vec![];
    for seed in 0..40 {
        let (seconds, done) = simulate(channels[0].clone(), video.clone(), seed).await;
        done.unwrap();
        alone.push(seconds);
    }
    // The first call fits the video too.
    let mut alone = alone.split_off(1);
    let (usual, slow) = (percentile(&mut alone, 0.5), percentile(&mut alone, 0.99));
    let mut served = offer(&channels, &video, 10.0 / usual, time, 1_000).await;
    let resident = program.resident();
    assert!(!served.done.is_empty() && !served.refused.is_empty(), "nothing was refused");
    // One call at a time always finds a free slot, on a machine of any speed, unless the load left jobs behind.
    let mut after = vec![];
    for seed in 1_000_000..1_000_020 {
        let (seconds, done) = simulate(channels[0].clone(), video.clone(), seed).await;
        done.expect("it refuses though the load is over");
        after.push(seconds);
    }
    assert!(resident < 512.0, "{resident} MiB");
    println!(
        "queue {queue}, alone {:.1} ms (p99 {:.1}); {time:?} of tenfold load: {} done, p99 {:.1} ms; {} refused, p50 {:.1} ms, \
         p99 {:.1} ms; {resident:.0} MiB; afterwards p99 {:.1} ms",
        1e3 * usual,
        1e3 * slow,
        served.done.len(),
        1e3 * percentile(&mut served.done, 0.99),
        served.refused.len(),
        1e3 * percentile(&mut served.refused, 0.5),
        1e3 * percentile(&mut served.refused, 0.99),
        1e3 * percentile(&mut after, 0.99),
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_times_too_much_is_refused_and_soon_forgotten() {
    let folder = tempfile::tempdir().unwrap();
    overload(folder.path(), "1").await;
    if is_long() {
        let folder = tempfile::tempdir().unwrap();
        overload(folder.path(), "256").await;
    }
}
