//! The HTTP port, and what every call leaves behind: an id and its metrics.

use crate::harness::*;
use rustls_pki_types::pem::PemObject;
use rustls_pki_types::{CertificateDer, ServerName};
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tonic::Request;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};
use vrdp::api::v1::statistics_client::StatisticsClient;
use vrdp::api::{
    self, PortContext, PortLimits, ReadinessLimits, Security, ServerLimits, Tls, Tokens, serve_http, v1,
};
use vrdp::engine::Engine;

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
    context: impl Into<PortContext>,
) -> (SocketAddr, JoinHandle<std::io::Result<()>>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let pages = serve_http(listener, service.engine.clone(), context.into(), std::future::pending());
    (address, tokio::spawn(pages))
}

/// Sends one request with header fields and a form, and reads the whole response.
async fn send(mut stream: impl AsyncRead + AsyncWrite + Unpin, line: &str, head: &str, form: &str) -> String {
    let head = format!(
        "{line} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: {}\r\n{head}\r\n",
        form.len()
    );
    stream.write_all(format!("{head}{form}").as_bytes()).await.unwrap();
    let mut page = vec![];
    // A TLS connection that ends without a farewell is an error that says nothing here.
    let _ = stream.read_to_end(&mut page).await;
    String::from_utf8_lossy(&page).into_owned()
}

fn tokens() -> Arc<Tokens> {
    Arc::new(Tokens::parse("secret-of-lab-a-00 = lab-a\nsecret-of-lab-b-00 = lab-b").unwrap())
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
    let (address, pages) = open(&service, Security::default()).await;
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
    let (address, pages) = open(&service, Security::default()).await;
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

    let (guarded, more) = open(&service, Security { tokens: Some(tokens()), tls: None }).await;
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

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_logs_in_with_a_token_and_out() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let context = PortContext::from(Security { tokens: Some(tokens()), tls: None });
    let (address, pages) = open(&service, context.clone()).await;
    let ask = async |line: &str, head: &str, form: &str| {
        send(TcpStream::connect(address).await.unwrap(), line, head, form).await
    };
    let form = ask("GET /?after=x", "Accept: text/html\r\n", "").await;
    assert!(
        form.starts_with("HTTP/1.1 401") && form.contains("action=\"/login\"") && form.contains("/?after=x"),
        "{form}"
    );
    let wrong = ask("POST /login", "", "token=secret-of-lab-c-00&next=%2F").await;
    assert!(wrong.starts_with("HTTP/1.1 401") && !wrong.contains("secret-of-lab-c-00"), "{wrong}");
    let foreign = ask("POST /login", "Origin: http://evil.example\r\n", "token=secret-of-lab-a-00").await;
    assert!(foreign.starts_with("HTTP/1.1 403"), "{foreign}");
    let done =
        ask("POST /login", "Origin: http://localhost\r\n", "token=secret-of-lab-a-00&next=%2Flogin").await;
    assert!(done.starts_with("HTTP/1.1 303") && done.contains("location: /login"), "{done}");
    let cookie = done.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    assert!(
        cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict") && !cookie.contains("secret"),
        "{cookie}"
    );
    let cookie = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
    let overview = ask("GET /", &cookie, "").await;
    assert!(overview.starts_with("HTTP/1.1 200") && overview.contains("lab-a"), "{overview}");
    let bearer = "Authorization: Bearer secret-of-lab-b-00\r\n";
    assert!(ask("GET /", bearer, "").await.contains("lab-b"));
    // A revoked token ends its sessions, and so does the button.
    let only_b = Tokens::parse("secret-of-lab-b-00 = lab-b").unwrap();
    context.security.replace(Security { tokens: Some(Arc::new(only_b)), tls: None });
    assert!(ask("GET /", &cookie, "").await.starts_with("HTTP/1.1 401"));
    context.security.replace(Security { tokens: Some(tokens()), tls: None });
    assert!(ask("GET /login", &cookie, "").await.contains("lab-a"));
    assert!(ask("POST /logout", &cookie, "").await.contains("Max-Age=0"));
    assert!(ask("GET /", &cookie, "").await.starts_with("HTTP/1.1 401"));
    // Probes and Prometheus need no token.
    for path in ["/livez", "/readyz", "/healthz", "/metrics"] {
        assert!(get(address, path).await.starts_with("HTTP/1.1 200"), "{path}");
    }
    pages.abort();
    let _ = pages.await;
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_are_shown_by_nobody_else_and_run_only_their_own_script() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let limits = PortLimits { hosts: vec!["lab.example".into()], ..PortLimits::default() };
    let (address, pages) = open(&service, PortContext::new(Security::default(), limits)).await;
    for path in ["/", "/nothing", "/metrics", "/videos/abc/report"] {
        let page = get(address, path).await;
        for field in [
            "x-content-type-options: nosniff",
            "x-frame-options: DENY",
            "referrer-policy: no-referrer",
            "frame-ancestors 'none'",
        ] {
            assert!(page.contains(field), "{path}: {page}");
        }
    }
    let page = get(address, "/").await;
    let nonce = page.split("'nonce-").nth(1).unwrap().split('\'').next().unwrap();
    assert!(nonce.len() == 64 && page.contains(&format!("<script nonce=\"{nonce}\">")), "{page}");
    assert!(!get(address, "/").await.contains(nonce));
    for (host, code) in [
        ("localhost", "200"),
        ("LAB.example:8080", "200"),
        ("[::1]:8080", "200"),
        ("10.1.2.3", "200"),
        ("evil.example", "421"),
        ("localhost.evil.example", "421"),
    ] {
        let page = ask(address, "/metrics", host).await;
        assert!(page.starts_with(format!("HTTP/1.1 {code}").as_bytes()), "{host}");
    }
    // The metrics of the process have their usual names.
    let metrics = get(address, "/metrics").await;
    assert!(
        !cfg!(target_os = "linux") || figure(&metrics, "process_resident_memory_bytes ") > 1e6,
        "{metrics}"
    );
    pages.abort();
    let _ = pages.await;
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_http_port_is_encrypted_with_the_same_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let made = rcgen::generate_simple_self_signed(["localhost".to_string()]).unwrap();
    let (certificate, key) = (made.cert.pem(), made.signing_key.serialize_pem());
    let connector = || {
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(certificate.as_bytes()).unwrap()).unwrap();
        let provider = Arc::new(tokio_rustls::rustls::crypto::ring::default_provider());
        let client =
            ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
        TlsConnector::from(Arc::new(client.with_root_certificates(roots).with_no_client_auth()))
    };
    // The authority of clients asks for their certificate wherever there is more than health and metrics.
    for (authority, code) in [(None, "200"), (Some(certificate.as_str()), "403")] {
        let tls = Some(Tls::from_pem(&certificate, &key, authority).unwrap());
        let (address, pages) = open(&service, Security { tokens: None, tls }).await;
        for (path, code) in [("/", code), ("/readyz", "200")] {
            let stream = TcpStream::connect(address).await.unwrap();
            let stream =
                connector().connect(ServerName::try_from("localhost").unwrap(), stream).await.unwrap();
            let page = send(stream, &format!("GET {path}"), "", "").await;
            assert!(page.starts_with(&format!("HTTP/1.1 {code}")), "{path}: {page}");
        }
        // A plain request is no handshake.
        let plain = send(TcpStream::connect(address).await.unwrap(), "GET /", "", "").await;
        assert!(!plain.starts_with("HTTP/1.1 200"), "{plain}");
        pages.abort();
        let _ = pages.await;
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn readiness_is_of_the_disk_and_of_the_drain_and_liveness_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let engine = Arc::new(Engine::open(folder.path(), CAPACITY).unwrap());
    let full = |free_bytes| {
        let readiness = ReadinessLimits { free_bytes, ..ReadinessLimits::default() };
        PortContext::new(Security::default(), PortLimits { readiness, ..PortLimits::default() })
    };
    for (free_bytes, ready, status) in
        [(u64::MAX, "503", ServingStatus::NotServing), (0, "200", ServingStatus::Serving)]
    {
        let context = full(free_bytes);
        let (grpc, http) = (
            TcpListener::bind("127.0.0.1:0").await.unwrap(),
            TcpListener::bind("127.0.0.1:0").await.unwrap(),
        );
        let (url, address) = (format!("http://{}", grpc.local_addr().unwrap()), http.local_addr().unwrap());
        let (stop, ended) = tokio::sync::oneshot::channel::<()>();
        let until = async {
            let _ = ended.await;
        };
        let calls =
            tokio::spawn(api::serve(grpc, engine.clone(), ServerLimits::default(), context.clone(), until));
        let pages = tokio::spawn(serve_http(http, engine.clone(), context, std::future::pending()));
        let page = get(address, "/readyz").await;
        assert!(page.starts_with(&format!("HTTP/1.1 {ready}")), "{page}");
        assert!(ready == "200" || page.contains("min_free_bytes"), "{page}");
        assert!(get(address, "/livez").await.starts_with("HTTP/1.1 200"));
        let channel = tonic::transport::Endpoint::from_shared(url).unwrap().connect().await.unwrap();
        let mut health = HealthClient::new(channel);
        for service in ["", "vrdp.v1.Videos", "vrdp.v1.Operations"] {
            let reply = health.check(HealthCheckRequest { service: service.into() }).await.unwrap();
            assert_eq!(reply.into_inner().status(), status, "{service}");
        }
        let watched = HealthCheckRequest { service: "vrdp.v1.Models".into() };
        let mut watch = health.watch(watched).await.unwrap().into_inner();
        assert_eq!(watch.message().await.unwrap().unwrap().status(), status);
        stop.send(()).unwrap();
        if status == ServingStatus::Serving {
            assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::NotServing);
            assert!(get(address, "/readyz").await.contains("drains"));
        }
        drop((watch, health));
        calls.await.unwrap().unwrap();
        pages.abort();
        let _ = pages.await;
    }
}
