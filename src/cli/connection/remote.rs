//! Connects to a remote service: URL, TLS, token, and retries while the service is busy or unreachable.

use super::target::Target;
use crate::cli::error::Failure;
use crate::cli::output::{self, progress};
use crate::config::{NO_AUTHORITY, certificate_problem, key_problem, pem_text};
use axum::body::to_bytes;
use std::error::Error;
use std::fmt::Display;
use std::future::Future;
use std::net::IpAddr;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::{Instant, sleep};
use tonic::body::Body;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{self, Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;
use tower::Service;

/// Attempts to reach a service; the wait after the first doubles up to the longest, as in
/// `proto/vrdp/v1/service_config.json`.
const ATTEMPTS: u32 = 5;
const FIRST_WAIT: Duration = Duration::from_millis(200);
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// How long a call to a busy service is repeated, with the delay that the service asks for.
const DEADLINE: Duration = Duration::from_secs(60);

/// Adds the token, if there is one, to every call.
#[derive(Clone)]
pub struct Bearer(Option<MetadataValue<Ascii>>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            request.metadata_mut().insert("authorization", token.clone());
        }
        Ok(request)
    }
}

/// A connection to a service, local or remote.
pub type ServiceChannel = InterceptedService<RetryingChannel, Bearer>;

/// A channel that repeats a call while the service is busy or unreachable, and explains TLS errors.
/// Repeating a call is safe: the service names everything by its content.
#[derive(Clone)]
pub struct RetryingChannel {
    channel: Channel,
    url: Arc<str>,
}

impl Service<http::Request<Body>> for RetryingChannel {
    type Response = http::Response<Body>;
    type Error = Status;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Status>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Status>> {
        // Each attempt waits for the channel by itself.
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let RetryingChannel { mut channel, url } = self.clone();
        Box::pin(async move {
            let (head, body) = request.into_parts();
            let whole = to_bytes(axum::body::Body::new(body), usize::MAX).await;
            let bytes = whole.map_err(|e| Status::from_error(e.into_inner()))?;
            let start = Instant::now();
            for attempt in 1.. {
                let body = Body::new(axum::body::Body::from(bytes.clone()));
                let request = http::Request::from_parts(head.clone(), body);
                let reply = send(&mut channel, request).await;
                let refused = match &reply {
                    Ok(response) => Status::from_header_map(response.headers()),
                    Err(error) => Some(explained(error, &url)),
                };
                let wait = refused.as_ref().and_then(|status| wait(status, attempt, start.elapsed()));
                match (wait, reply) {
                    (Some(wait), _) => {
                        if attempt == 1 && !progress::is_quiet() {
                            output::tell("the service is busy or unreachable; trying again");
                        }
                        sleep(wait).await;
                    }
                    (None, Ok(response)) => return Ok(response),
                    (None, Err(error)) => return Err(explained(&error, &url)),
                }
            }
            Err(Status::unavailable("the service is still busy or unreachable; try again later"))
        })
    }
}

async fn send(
    channel: &mut Channel,
    request: http::Request<Body>,
) -> Result<http::Response<Body>, transport::Error> {
    std::future::poll_fn(|cx| channel.poll_ready(cx)).await?;
    channel.call(request).await
}

/// Repeats a call whose reply broke off, with the attempts and waits of an unreachable service.
pub async fn retried<T>(call: impl AsyncFn() -> Result<T, Status>) -> Result<T, Status> {
    for attempt in 1..ATTEMPTS {
        match call().await {
            Err(status) if broke_off(&status) => {
                if attempt == 1 && !progress::is_quiet() {
                    output::tell("the connection broke; trying again");
                }
                sleep(wait_of(attempt)).await;
            }
            done => return done,
        }
    }
    call().await
}

/// Whether the connection broke during a reply. An error that the service itself sends has no source.
fn broke_off(status: &Status) -> bool {
    status.source().is_some()
}

fn wait_of(attempt: u32) -> Duration {
    (FIRST_WAIT * 2u32.pow(attempt - 1)).min(LONGEST_WAIT)
}

/// How long to wait before the call is repeated; `None`: repeating does not help.
fn wait(status: &Status, attempt: u32, passed: Duration) -> Option<Duration> {
    let asked = status.get_details_retry_info().and_then(|info| info.retry_delay);
    let reason = status.get_details_error_info().map(|info| info.reason);
    match status.code() {
        Code::ResourceExhausted | Code::Unavailable if asked.is_some() => {
            asked.filter(|wait| passed + *wait <= DEADLINE)
        }
        // A failed disk needs an operator: repeating does not help.
        Code::Unavailable if reason.as_deref() != Some("STORAGE") && attempt < ATTEMPTS => {
            Some(wait_of(attempt))
        }
        _ => None,
    }
}

/// Connects with the certificates and the token of the target.
pub async fn remote(url: &str, target: &Target) -> Result<ServiceChannel, Failure> {
    let wrong = |why: &dyn Display| {
        Failure::input(format!("--server {url}: {why}; write it as http://HOST:PORT or https://HOST:PORT"))
    };
    let mut endpoint = Endpoint::from_shared(url.to_string()).map_err(|e| wrong(&e))?;
    match endpoint.uri().scheme_str() {
        Some("https") => {
            let bad = |e| Failure::input(format!("--ca, --cert or --key: {}; give PEM files", cause(&e)));
            endpoint = endpoint.tls_config(tls(target)?).map_err(bad)?;
        }
        Some("http") if target.token.is_some() && !endpoint.uri().host().is_some_and(is_here) => {
            let message = format!("--token would be sent to {url} unencrypted; use https://");
            return Err(Failure::input(message));
        }
        Some("http") if target.ca.is_some() || target.cert.is_some() || target.key.is_some() => {
            let message = format!("--ca, --cert and --key have no effect on {url}; use https://");
            return Err(Failure::input(message));
        }
        Some("http") => {}
        _ => return Err(wrong(&"the scheme is missing or unknown")),
    }
    let bearer = Bearer(target.token.as_deref().map(token).transpose()?);
    let failed = |e| Failure::other(explained(&e, url).message());
    let channel = endpoint.connect().await.map_err(failed)?;
    Ok(InterceptedService::new(RetryingChannel { channel, url: url.into() }, bearer))
}

fn is_here(host: &str) -> bool {
    host == "localhost" || host.trim_matches(['[', ']']).parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// The innermost source of an error of the transport: the outer ones say little.
fn cause(error: &transport::Error) -> String {
    let mut last: &dyn Error = error;
    while let Some(deeper) = last.source() {
        last = deeper;
    }
    last.to_string()
}

/// An error of the transport, and what to do.
fn explained(error: &transport::Error, url: &str) -> Status {
    let cause = cause(error);
    let code = if cause.contains("Connection refused") { Code::Unavailable } else { Code::Unknown };
    let advice = advice(&cause, url.starts_with("https:"));
    let proxy = if advice == IS_IT_RUNNING { proxy_advice(url, |name| std::env::var(name).ok()) } else { "" };
    Status::new(code, format!("{url}: {cause}; {advice}{proxy}"))
}

const IS_IT_RUNNING: &str = "is the service running?";

/// What to do if the environment asks for a proxy: a call goes to the service directly.
fn proxy_advice(url: &str, variable: impl Fn(&str) -> Option<String>) -> &'static str {
    let encrypted = url.starts_with("https:");
    let names = if encrypted { ["https_proxy", "HTTPS_PROXY"] } else { ["http_proxy", "HTTP_PROXY"] };
    let is_set = names
        .into_iter()
        .chain(["all_proxy", "ALL_PROXY"])
        .any(|name| variable(name).is_some_and(|v| !v.is_empty()));
    if is_set {
        " A proxy is set in the environment, but calls go to the service directly: open that way, or use a tunnel"
    } else {
        ""
    }
}

/// What to do, by the words that `rustls` and `hyper` use in their errors.
fn advice(cause: &str, encrypted: bool) -> &'static str {
    let says = |words: &[&str]| words.iter().any(|w| cause.contains(w));
    if encrypted && says(&["InvalidContentType"]) {
        "the service does not use TLS: write http://, or give the service a certificate"
    } else if says(&["UnknownIssuer"]) {
        "no trusted authority signed its certificate: name the right one with --ca"
    } else if says(&["CaUsedAsEndEntity"]) {
        NO_AUTHORITY
    } else if says(&["UnsupportedCertVersion"]) {
        "its certificate has no extensions (version 1): make it again with -addext subjectAltName=DNS:HOST"
    } else if says(&["NotValidForName", "not valid for name"]) {
        "its certificate is for another host name: use that name in --server"
    } else if says(&["Expired", "expired", "NotValidYet", "not valid yet"]) {
        "its certificate has expired or is not valid yet: renew it, or set the clock"
    } else if says(&["CertificateRequired"]) || (encrypted && says(&["broken pipe", "closed", "reset"])) {
        "the service asks for a client certificate: give --cert and --key"
    } else if encrypted && says(&["alert"]) {
        "the service rejects the client certificate: give one that its --tls-client-ca signed, with --cert and --key"
    } else if !encrypted && says(&["http2 error", "frame", "broken pipe", "Broken pipe", "reset", "closed"]) {
        "if the service uses TLS, write https:// and name its authority with --ca"
    } else {
        IS_IT_RUNNING
    }
}

fn tls(target: &Target) -> Result<ClientTlsConfig, Failure> {
    let tls = match &target.ca {
        Some(ca) => {
            let text = checked("--ca", ca, certificate_problem)?;
            ClientTlsConfig::new().ca_certificate(Certificate::from_pem(text))
        }
        None => ClientTlsConfig::new().with_native_roots(),
    };
    if target.cert.is_some() != target.key.is_some() {
        return Err(Failure::input("--cert and --key belong together; give both"));
    }
    Ok(match (&target.cert, &target.key) {
        (Some(cert), Some(key)) => {
            let (cert, key) =
                (checked("--cert", cert, certificate_problem)?, checked("--key", key, key_problem)?);
            tls.identity(Identity::from_pem(cert, key))
        }
        _ => tls,
    })
}

fn token(path: &Path) -> Result<MetadataValue<Ascii>, Failure> {
    let wrong = |_| {
        Failure::input(format!(
            "--token {}: the file holds no valid token; give a file with one token",
            path.display()
        ))
    };
    let text = format!("Bearer {}", read("--token", path)?.trim());
    let mut value: MetadataValue<Ascii> = text.parse().map_err(wrong)?;
    value.set_sensitive(true);
    Ok(value)
}

fn read(flag: &str, path: &Path) -> Result<String, Failure> {
    let wrong = |problem: String| Failure::input(format!("{flag} {}: {problem}", path.display()));
    let bytes = std::fs::read(path).map_err(|e| wrong(format!("{e}; give a readable file")))?;
    pem_text(bytes).map_err(|problem| wrong(problem.into()))
}

/// The text of a PEM file, if `problem` finds none.
fn checked(flag: &str, path: &Path, problem: fn(&str) -> Option<&'static str>) -> Result<String, Failure> {
    let text = read(flag, path)?;
    match problem(&text) {
        Some(problem) => Err(Failure::input(format!("{flag} {}: {problem}", path.display()))),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1::ListEffectsRequest;
    use crate::api::v1::models_client::ModelsClient;
    use std::collections::HashMap;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;
    use tonic_types::ErrorDetails;

    #[test]
    fn calls_to_a_busy_service_follow_its_delay_and_to_an_unreachable_one_stop() {
        let second = Duration::from_secs(1);
        let with = |code, reason: &str, wait| {
            let mut details = ErrorDetails::with_error_info(reason, "vrdp", HashMap::new());
            details.set_retry_info(wait);
            Status::with_error_details(code, "", details)
        };
        let busy = with(Code::ResourceExhausted, "OVERLOADED", Some(second));
        assert_eq!(wait(&busy, 40, 59 * second), Some(second));
        assert_eq!(wait(&busy, 1, DEADLINE), None);
        assert_eq!(wait(&Status::resource_exhausted("too large"), 1, second), None);
        let unreachable = Status::unavailable("");
        let waits: Vec<_> = (1..=5).map(|k| wait(&unreachable, k, second).map(|w| w.as_millis())).collect();
        assert_eq!(waits, [Some(200), Some(400), Some(800), Some(1600), None]);
        assert_eq!(wait(&with(Code::Unavailable, "STORAGE", None), 1, second), None);
        assert_eq!(wait(&Status::invalid_argument(""), 1, second), None);
    }

    /// Answers every connection with these bytes.
    async fn answering(bytes: &'static [u8]) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(async move {
            while let Ok((mut socket, _)) = listener.accept().await {
                let _ = socket.read(&mut [0; 64]).await;
                let _ = socket.write_all(bytes).await;
            }
        });
        address.to_string()
    }

    #[test]
    fn certificates_as_people_make_them_give_words() {
        for (cause, word) in [
            ("invalid peer certificate: Other(OtherError(CaUsedAsEndEntity))", "CA:FALSE"),
            (
                "invalid peer certificate: certificate not valid for name \"a\"; certificate is only valid for b",
                "another host",
            ),
            ("invalid peer certificate: certificate expired: verification time 2 (UNIX)", "expired"),
            (
                "invalid peer certificate: certificate not valid yet: verification time 2 (UNIX)",
                "not valid yet",
            ),
            ("invalid peer certificate: UnknownIssuer", "--ca"),
        ] {
            assert!(advice(cause, true).contains(word), "{cause}: {}", advice(cause, true));
        }
        let set = |name: &str| (name == "HTTPS_PROXY").then(|| "http://proxy:3128".to_string());
        assert!(proxy_advice("https://host:1", set).contains("proxy"));
        assert_eq!([proxy_advice("http://host:1", set), proxy_advice("https://host:1", |_| None)], [""; 2]);
    }

    #[tokio::test]
    async fn a_tls_mismatch_says_what_to_do() {
        // A fatal TLS alert, as a TLS server sends it to a plain client; then a plain HTTP reply to a TLS client.
        let encrypted = format!("http://{}", answering(&[21, 3, 3, 0, 2, 2, 70]).await);
        let channel = remote(&encrypted, &Target::default()).await.unwrap();
        let status = ModelsClient::new(channel).list_effects(ListEffectsRequest {}).await.unwrap_err();
        assert!(status.message().contains("write https://"), "{status:?}");
        let plain = format!("https://{}", answering(b"HTTP/1.1 400 Bad Request\r\n\r\n").await);
        let failure = remote(&plain, &Target::default()).await.err().unwrap().to_string();
        assert!(failure.contains("write http://"), "{failure}");
        let ca = Target { ca: Some("x".into()), ..Target::default() };
        assert!(remote(&encrypted, &ca).await.err().unwrap().to_string().contains("use https://"));
    }
}
