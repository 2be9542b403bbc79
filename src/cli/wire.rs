//! The way to a service elsewhere: its URL, whom to trust, how it knows us, and patience where it is busy.

use super::error::Failure;
use super::{Target, output, progress};
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

/// Attempts where a service is away, and the wait after the first, which doubles up to the longest: as the published
/// policy says (`proto/vrdp/v1/service_config.json`).
const ATTEMPTS: u32 = 5;
const FIRST_WAIT: Duration = Duration::from_millis(200);
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// How long a busy service is asked again, at the pace that it asks for.
const DEADLINE: Duration = Duration::from_secs(60);

/// Sends the token, if there is one, with every call.
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

pub type Wire = InterceptedService<Patient, Bearer>;

/// A channel that sends a call anew where the service was too busy or away, and says what to do where both sides do not
/// agree on TLS. Every call may be sent twice: what it makes has a name by its content.
#[derive(Clone)]
pub struct Patient {
    channel: Channel,
    url: Arc<str>,
}

impl Service<http::Request<Body>> for Patient {
    type Response = http::Response<Body>;
    type Error = Status;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Status>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Status>> {
        // Each attempt waits for the channel by itself.
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let Patient { mut channel, url } = self.clone();
        Box::pin(async move {
            let (head, body) = request.into_parts();
            let whole = to_bytes(axum::body::Body::new(body), usize::MAX).await;
            let bytes = whole.map_err(|e| Status::from_error(e.into_inner()))?;
            let began = Instant::now();
            for attempt in 1.. {
                let body = Body::new(axum::body::Body::from(bytes.clone()));
                let request = http::Request::from_parts(head.clone(), body);
                let reply = send(&mut channel, request).await;
                let refused = match &reply {
                    Ok(response) => Status::from_header_map(response.headers()),
                    Err(error) => Some(told(error, &url)),
                };
                let wait = refused.as_ref().and_then(|status| wait(status, attempt, began.elapsed()));
                match (wait, reply) {
                    (Some(wait), _) => {
                        if attempt == 1 && !progress::is_quiet() {
                            output::tell("the service is busy or away: tries again");
                        }
                        sleep(wait).await;
                    }
                    (None, Ok(response)) => return Ok(response),
                    (None, Err(error)) => return Err(told(&error, &url)),
                }
            }
            Err(Status::unavailable("too many attempts"))
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

/// Sends a call anew whose reply broke off, as often and at the pace of one that does not reach its service.
pub async fn again<T>(call: impl AsyncFn() -> Result<T, Status>) -> Result<T, Status> {
    for attempt in 1..ATTEMPTS {
        match call().await {
            Err(status) if broke_off(&status) => {
                if attempt == 1 && !progress::is_quiet() {
                    output::tell("the service went away: tries again");
                }
                sleep(wait_of(attempt)).await;
            }
            done => return done,
        }
    }
    call().await
}

/// Whether a reply ended with its connection. What the service itself says has no cause.
fn broke_off(status: &Status) -> bool {
    status.source().is_some()
}

fn wait_of(attempt: u32) -> Duration {
    (FIRST_WAIT * 2u32.pow(attempt - 1)).min(LONGEST_WAIT)
}

/// How long to wait before the call is sent anew; `None` where that is of no use.
fn wait(status: &Status, attempt: u32, passed: Duration) -> Option<Duration> {
    let asked = status.get_details_retry_info().and_then(|info| info.retry_delay);
    let reason = status.get_details_error_info().map(|info| info.reason);
    match status.code() {
        Code::ResourceExhausted | Code::Unavailable if asked.is_some() => {
            asked.filter(|wait| passed + *wait <= DEADLINE)
        }
        // A disk that failed is put right by somebody.
        Code::Unavailable if reason.as_deref() != Some("STORAGE") && attempt < ATTEMPTS => {
            Some(wait_of(attempt))
        }
        _ => None,
    }
}

/// Connects, with what the target says of certificates and tokens.
pub async fn remote(url: &str, target: &Target) -> Result<Wire, Failure> {
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
            let message = format!("--token would be sent to {url} for all to read; use https://");
            return Err(Failure::input(message));
        }
        Some("http") if target.ca.is_some() || target.cert.is_some() || target.key.is_some() => {
            let message = format!("--ca, --cert and --key are of no use with {url}; use https://");
            return Err(Failure::input(message));
        }
        Some("http") => {}
        _ => return Err(wrong(&"the protocol is missing or unknown")),
    }
    let bearer = Bearer(target.token.as_deref().map(token).transpose()?);
    let lost = |e| Failure::other(told(&e, url).message());
    let channel = endpoint.connect().await.map_err(lost)?;
    Ok(InterceptedService::new(Patient { channel, url: url.into() }, bearer))
}

fn is_here(host: &str) -> bool {
    host == "localhost" || host.trim_matches(['[', ']']).parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// What lies under an error of the transport, which says little by itself.
fn cause(error: &transport::Error) -> String {
    let mut last: &dyn Error = error;
    while let Some(deeper) = last.source() {
        last = deeper;
    }
    last.to_string()
}

/// An error of the transport with what to do about it.
fn told(error: &transport::Error, url: &str) -> Status {
    let cause = cause(error);
    let code = if cause.contains("Connection refused") { Code::Unavailable } else { Code::Unknown };
    Status::new(code, format!("{url}: {cause}; {}", advice(&cause, url.starts_with("https:"))))
}

/// What to do about such an error, by what `rustls` and `hyper` call it.
fn advice(cause: &str, encrypted: bool) -> &'static str {
    let says = |words: &[&str]| words.iter().any(|w| cause.contains(w));
    if encrypted && says(&["InvalidContentType"]) {
        "no TLS is spoken there: write http://, or give the service a certificate"
    } else if says(&["UnknownIssuer"]) {
        "its certificate is not signed by whom we trust: give the right authority's with --ca"
    } else if says(&["NotValidForName"]) {
        "its certificate is for another name: use that in --server"
    } else if says(&["Expired", "NotValidYet"]) {
        "its certificate is not valid today: renew it, or set the clock"
    } else if says(&["CertificateRequired"]) || (encrypted && says(&["broken pipe", "closed", "reset"])) {
        "the service wants to know us: give --cert and --key"
    } else if encrypted && says(&["alert"]) {
        "the service does not accept our certificate: give one that its --tls-client-ca signed with --cert and --key"
    } else if !encrypted && says(&["http2 error", "frame", "broken pipe", "Broken pipe", "reset", "closed"]) {
        "if TLS is spoken there, write https:// and give its authority with --ca"
    } else {
        "is the service running?"
    }
}

fn tls(target: &Target) -> Result<ClientTlsConfig, Failure> {
    let tls = match &target.ca {
        Some(ca) => ClientTlsConfig::new().ca_certificate(Certificate::from_pem(read("--ca", ca)?)),
        None => ClientTlsConfig::new().with_native_roots(),
    };
    if target.cert.is_some() != target.key.is_some() {
        return Err(Failure::input("--cert and --key go together; give both"));
    }
    Ok(match (&target.cert, &target.key) {
        (Some(cert), Some(key)) => {
            tls.identity(Identity::from_pem(read("--cert", cert)?, read("--key", key)?))
        }
        _ => tls,
    })
}

fn token(path: &Path) -> Result<MetadataValue<Ascii>, Failure> {
    let wrong = |_| Failure::input(format!("--token {}: is no token; give a file with one", path.display()));
    let text = format!("Bearer {}", read("--token", path)?.trim());
    let mut value: MetadataValue<Ascii> = text.parse().map_err(wrong)?;
    value.set_sensitive(true);
    Ok(value)
}

fn read(flag: &str, path: &Path) -> Result<String, Failure> {
    let wrong = |e| Failure::input(format!("{flag} {}: {e}; give a file that can be read", path.display()));
    std::fs::read_to_string(path).map_err(wrong)
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
    fn a_busy_service_is_asked_again_at_its_pace_and_one_that_is_away_a_few_times() {
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
        let away = Status::unavailable("");
        let waits: Vec<_> = (1..=5).map(|k| wait(&away, k, second).map(|w| w.as_millis())).collect();
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

    #[tokio::test]
    async fn whoever_mixes_up_tls_is_told_what_to_do() {
        // A fatal alert of TLS, such as a TLS server sends to who speaks otherwise; and a greeting without TLS.
        let encrypted = format!("http://{}", answering(&[21, 3, 3, 0, 2, 2, 70]).await);
        let wire = remote(&encrypted, &Target::default()).await.unwrap();
        let status = ModelsClient::new(wire).list_effects(ListEffectsRequest {}).await.unwrap_err();
        assert!(status.message().contains("write https://"), "{status:?}");
        let plain = format!("https://{}", answering(b"HTTP/1.1 400 Bad Request\r\n\r\n").await);
        let failure = remote(&plain, &Target::default()).await.err().unwrap().to_string();
        assert!(failure.contains("write http://"), "{failure}");
        let ca = Target { ca: Some("x".into()), ..Target::default() };
        assert!(remote(&encrypted, &ca).await.err().unwrap().to_string().contains("use https://"));
    }
}
