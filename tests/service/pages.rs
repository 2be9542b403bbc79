//! The HTTP port, and what every call leaves behind: an id and its metrics.

use crate::harness::*;
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tonic::Request;
use vrdp::api::serve_http;
use vrdp::api::v1::statistics_client::StatisticsClient;
use vrdp::api::{Tokens, v1};

/// Status line, header fields and body of a page.
async fn get(address: SocketAddr, path: &str) -> String {
    String::from_utf8_lossy(&ask(address, path, "localhost").await).into_owned()
}

async fn ask(address: SocketAddr, path: &str, host: &str) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut page = vec![];
    stream.read_to_end(&mut page).await.unwrap();
    page
}

/// The HTTP port of a service.
async fn open(
    service: &Running,
    tokens: Option<Arc<Tokens>>,
) -> (SocketAddr, JoinHandle<std::io::Result<()>>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let pages = serve_http(listener, service.engine.clone(), tokens, std::future::pending());
    (address, tokio::spawn(pages))
}

/// The value of the metric whose line starts with `begin`.
fn figure(page: &str, begin: &str) -> f64 {
    let line = page.lines().find(|line| line.starts_with(begin));
    line.unwrap_or_else(|| panic!("no {begin} in {page}")).rsplit(' ').next().unwrap().parse().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn metrics_are_read_over_http_and_name_no_video() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let (address, pages) = open(&service, None).await;
    assert!(get(address, "/healthz").await.starts_with("HTTP/1.1 200"));
    assert!(get(address, "/nothing").await.starts_with("HTTP/1.1 404"));
    let name = service.create(video("pages", 20)).await.unwrap();
    for _ in 0..2 {
        let ask = v1::SimulateRequest { video: name.clone(), rollouts: Some(1), ..Default::default() };
        service.reasoning().simulate(ask).await.unwrap();
    }
    let missing = v1::GetVideoRequest { name: "videos/abc".into(), ..Default::default() };
    service.videos().get_video(missing).await.unwrap_err();
    let busy = service.occupy().await;
    let mut statistics = StatisticsClient::new(service.channel.clone());
    let waits = v1::SimulateRequest { video: name.clone(), rollouts: Some(2), ..Default::default() };
    let mut caller = service.reasoning();
    let waiting = tokio::spawn(async move { caller.simulate(waits).await });
    let load = loop {
        let reply = statistics.get_statistics(v1::GetStatisticsRequest {}).await.unwrap().into_inner();
        match reply.jobs_waiting {
            0 => tokio::task::yield_now().await,
            _ => break reply,
        }
    };
    assert_eq!((load.jobs_running, load.workers, load.fits), (1, 1, 1));
    assert_eq!((load.jobs[0].kind.as_str(), &load.jobs[0].video), ("simulation", &name));
    waiting.abort();
    let page = get(address, "/metrics").await;
    // The metrics count other tests of this process too.
    for (begin, least) in [
        ("vrdp_calls_total{method=\"vrdp.v1.Reasoning/Simulate\",code=\"Ok\"}", 2.0),
        ("vrdp_calls_total{method=\"vrdp.v1.Videos/GetVideo\",code=\"NotFound\"}", 1.0),
        ("vrdp_call_seconds_bucket{method=\"vrdp.v1.Reasoning/Simulate\",le=\"+Inf\"}", 2.0),
        ("vrdp_results_total{kind=\"simulation\",source=\"memory\"}", 1.0),
        ("vrdp_results_total{kind=\"fit\",source=\"made\"}", 1.0),
        ("vrdp_fits_total", 1.0),
        ("vrdp_trace_bytes_total", 1000.0),
        ("vrdp_jobs_running", 1.0),
        ("vrdp_jobs_waiting", 0.0),
        ("vrdp_job_wait_seconds_count", 1.0),
    ] {
        assert!(figure(&page, begin) >= least, "{begin}: {page}");
    }
    assert!(!page.contains(&name["videos/".len()..]) && page.contains("# HELP vrdp_fits_total"));
    drop(busy);
    pages.abort();
    let _ = pages.await;
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_dashboard_leads_to_reports_and_traces() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let (address, pages) = open(&service, None).await;
    assert!(get(address, "/").await.contains("No videos yet"));
    let name = service.create(video("<script>pages", 20)).await.unwrap();
    let ask_for = v1::SimulateRequest { video: name.clone(), rollouts: Some(1), ..Default::default() };
    let done = service.reasoning().simulate(ask_for).await.unwrap().into_inner();
    let page = get(address, "/").await;
    assert!(page.contains("&lt;script&gt;pages") && !page.contains("<script>pages"), "{page}");
    assert!(page.contains(&format!("/{name}/report")) && page.contains(&format!("/{}.mcap", done.trace)));
    assert!(get(address, "/?after=x").await.starts_with("HTTP/1.1 400"));

    let report = get(address, &format!("/{name}/report")).await;
    assert!(report.starts_with("HTTP/1.1 200") && report.contains("<h1>"), "{report}");
    assert!(get(address, "/videos/abc/report").await.starts_with("HTTP/1.1 404"));
    assert!(get(address, "/videos/..%2f/report").await.starts_with("HTTP/1.1 400"));

    let download = v1::DownloadTraceRequest { name: done.trace.clone() };
    let mut stream = service.traces().download_trace(download).await.unwrap().into_inner();
    let mut bytes = vec![];
    while let Some(chunk) = stream.message().await.unwrap() {
        bytes.extend(chunk.data);
    }
    let file = ask(address, &format!("/{}.mcap", done.trace), "127.0.0.1").await;
    assert!(file.ends_with(&bytes) && !bytes.is_empty());
    assert!(get(address, "/traces/abc.mcap").await.starts_with("HTTP/1.1 404"));
    // The name of another site that points to this machine (DNS rebinding).
    assert!(ask(address, "/", "rebound.example").await.starts_with(b"HTTP/1.1 421"));

    let tokens = Tokens::parse("secret-of-lab-a-00 = lab-a").unwrap();
    let (guarded, more) = open(&service, Some(Arc::new(tokens))).await;
    assert!(get(guarded, "/").await.starts_with("HTTP/1.1 401"));
    for pages in [pages, more] {
        pages.abort();
        let _ = pages.await;
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_reply_names_its_request() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let ask = |id: Option<&'static str>| {
        let mut request = Request::new(v1::ListEffectsRequest::default());
        if let Some(id) = id {
            request.metadata_mut().insert("x-request-id", id.parse().unwrap());
        }
        let mut client = service.models();
        async move {
            let reply = client.list_effects(request).await.unwrap();
            reply.metadata().get("x-request-id").unwrap().to_str().unwrap().to_string()
        }
    };
    assert_eq!(ask(Some("mine-7")).await, "mine-7");
    let (first, second) = (ask(None).await, ask(Some("not one word")).await);
    assert!(first != second && !second.contains(' '), "{first} {second}");
    let refused = service.videos().get_video(v1::GetVideoRequest::default()).await.unwrap_err();
    assert!(refused.metadata().get("x-request-id").is_some());
    service.stop().await;
}
