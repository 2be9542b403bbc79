//! Hostile or overloading clients, and what a well-behaved client notices of them.

use crate::endure::{Program, count, is_long};
use crate::harness::*;
use crate::process::BothPorts;
use h2::client::{ResponseFuture, SendRequest};
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tonic::Code;
use tonic::transport::Channel;
use tonic_types::StatusExt;
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
    let refused = async |encoding: &str, head: [u8; 5], body: usize| -> (Code, Option<String>) {
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
        let field = |headers: &http::HeaderMap, name: &str| {
            headers.get(name).map(|value| value.to_str().unwrap().to_string())
        };
        let headers = match field(reply.headers(), "grpc-status") {
            Some(_) => reply.headers().clone(),
            None => reply.into_body().trailers().await.unwrap().unwrap(),
        };
        let code = Code::from_bytes(field(&headers, "grpc-status").unwrap().as_bytes());
        (code, field(&headers, "grpc-retry-pushback-ms"))
    };
    // A message that is marked as compressed is refused without decompression.
    assert_eq!(refused("gzip", [1, 0, 0, 39, 16], 10_000).await.0, Code::Unimplemented);
    // A message one byte above the limit is refused before its body is read; clients must not try it again.
    let [a, b, c, d] = ((16u32 << 20) + 1).to_be_bytes();
    let never = Some("-1".to_string());
    assert_eq!(refused("identity", [0, a, b, c, d], 0).await, (Code::ResourceExhausted, never));
    // Bytes that are no message are the caller's mistake: in the frame, in the message, and where the message is cut.
    for (head, body) in
        [([7, 0, 0, 0, 4], 4), ([0, 0, 0, 0, 4], 4), ([0, 0, 0, 1, 0], 4), ([1, 0, 0, 0, 4], 4)]
    {
        assert_eq!(refused("identity", head, body).await, (Code::InvalidArgument, None), "{head:?}");
    }
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

/// A video whose message has about `megabytes` MB.
fn large(name: &str, megabytes: usize) -> v1::Video {
    let mut made = video(name, 20);
    let one = made.objects[0].clone();
    made.objects = (0..64)
        .map(|id| {
            let samples = (0..megabytes as u32 * 480).map(|f| sample(f, 0.001 * f64::from(f), f64::from(id)));
            // Two objects share each id: it is refused before it costs anything but bytes.
            v1::Object { id: id / 2, samples: samples.collect(), ..one.clone() }
        })
        .collect();
    made
}

#[tokio::test(flavor = "multi_thread")]
async fn bytes_in_flight_have_a_budget_and_who_exceeds_it_is_refused_at_once() {
    let uploads = count(48, 12);
    let folder = tempfile::tempdir().unwrap();
    // One caller has half of it: two messages of this size.
    let service = BothPorts::start(folder.path(), &[("VRDP_LOG", "off"), ("VRDP_REQUEST_BYTES", "33554432")]);
    let channel = Channel::from_shared(format!("http://{}", service.grpc)).unwrap().connect().await.unwrap();
    honest(&channel).await;
    let before = service.memory("VmRSS:");
    let mut calls = tokio::task::JoinSet::new();
    for k in 0..uploads {
        let request = v1::CreateVideoRequest { video: Some(large(&format!("{k}"), 6)), ..Default::default() };
        let mut client = VideosClient::new(channel.clone()).max_encoding_message_size(64 << 20);
        calls.spawn(async move { client.create_video(request).await.map(|_| ()) });
    }
    let (mut taken, mut refused) = (0, 0);
    while let Some(call) = calls.join_next().await {
        match call.unwrap() {
            Err(status) if status.code() == Code::ResourceExhausted => {
                assert!(status.get_details_retry_info().is_some(), "{status:?}");
                assert!(status.message().contains("share"), "{status:?}");
                refused += 1;
            }
            // Taken, whatever is wrong with it.
            _ => taken += 1,
        }
    }
    let peak = service.memory("VmHWM:") - before;
    assert!(taken > 0 && refused > 0, "{taken} taken, {refused} refused");
    assert!(peak < 256.0, "{peak} MiB more");
    // The budget is free again.
    honest(&channel).await;
    println!("{uploads} uploads at once: {taken} taken, {refused} refused; {peak:.0} MiB more at the peak");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_never_ends_is_ended_and_takes_nobodys_place() {
    let folder = tempfile::tempdir().unwrap();
    let settings = [("VRDP_LOG", "off"), ("VRDP_CONNECTIONS", "20")];
    let service = BothPorts::start(folder.path(), &settings);
    // Heads that never end, three times as many as there are places, on both ports.
    let mut idle = vec![];
    for _ in 0..60 {
        for (address, head) in [(&service.http, "GET / HTTP/1.1\r\nHost: loc"), (&service.grpc, "PRI * HT")] {
            let mut stream = TcpStream::connect(address).await.unwrap();
            // It may be closed already for another one.
            let _ = stream.write_all(head.as_bytes()).await;
            idle.push(stream);
        }
    }
    // A body that stops.
    let stream = TcpStream::connect(&service.grpc).await.unwrap();
    let (sender, connection) = h2::client::handshake(stream).await.unwrap();
    tokio::spawn(async move {
        let _ = connection.await;
    });
    let mut sender = sender.ready().await.unwrap();
    let (reply, mut body) =
        sender.send_request(call("/vrdp.v1.Videos/CreateVideo").body(()).unwrap(), false).unwrap();
    body.send_data(vec![0, 0, 1, 0, 0, 7, 7].into(), false).unwrap();

    // New clients are served on both ports, and what they store is durable.
    let channel = Channel::from_shared(format!("http://{}", service.grpc)).unwrap().connect().await.unwrap();
    let request = v1::CreateVideoRequest { video: Some(video("stored", 20)), ..Default::default() };
    VideosClient::new(channel.clone()).create_video(request).await.unwrap();
    let mut page = TcpStream::connect(&service.http).await.unwrap();
    page.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").await.unwrap();
    let mut text = String::new();
    page.read_to_string(&mut text).await.unwrap();
    assert!(text.starts_with("HTTP/1.1 200"), "{text}");

    // The others end: those without a place at once, the last ones at their deadline, and the body too.
    for mut stream in idle {
        // What it says before it closes does not matter.
        let _ = tokio::time::timeout(Duration::from_secs(60), stream.read_to_end(&mut vec![])).await.unwrap();
    }
    let reply = tokio::time::timeout(Duration::from_secs(60), reply).await.unwrap().unwrap();
    assert_eq!(reply.headers().get("grpc-status").unwrap(), "4", "{reply:?}");
    honest(&channel).await;
}
