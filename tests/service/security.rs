//! Authentication and what each tenant sees: tokens, TLS, certificates of clients.

use crate::harness::*;
use crate::process::BothPorts;
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Code, Request};
use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};
use vrdp::api::{Security, Tls, Tokens, v1};

const TOKENS: &str = "secret-of-lab-a-00 = lab-a\nsecret-of-lab-b-00 = lab-b";

fn with_tokens() -> Security {
    Security { tokens: Some(Arc::new(Tokens::parse(TOKENS).unwrap())), tls: None }
}

fn plainly(url: String) -> Endpoint {
    Endpoint::from_shared(url).unwrap()
}

fn of<T>(lab: &str, message: T) -> Request<T> {
    let token: MetadataValue<Ascii> = format!("Bearer secret-of-{lab}-00").parse().unwrap();
    let mut request = Request::new(message);
    request.metadata_mut().insert("authorization", token);
    request
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tenant_sees_its_own_data_and_callers_without_token_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = start_secured(folder.path(), CAPACITY, with_tokens(), plainly).await;
    let health = HealthCheckRequest::default();
    HealthClient::new(service.channel.clone()).check(health).await.unwrap();
    let stranger = service.create(video("mine", 20)).await.unwrap_err();
    assert_eq!(stranger.code(), Code::Unauthenticated, "{stranger:?}");
    let wrong = of("lab-c", v1::ListVideosRequest::default());
    assert_eq!(service.videos().list_videos(wrong).await.unwrap_err().code(), Code::Unauthenticated);

    let post = || v1::CreateVideoRequest { video: Some(video("mine", 20)), ..Default::default() };
    let name = service.videos().create_video(of("lab-a", post())).await.unwrap().into_inner().name;
    let simulate = || v1::SimulateRequest { video: name.clone(), rollouts: Some(1), ..Default::default() };
    let done = service.reasoning().simulate(of("lab-a", simulate())).await.unwrap().into_inner();
    // Results in memory and in the store, the trace and its file do not exist for the other tenant.
    let get = || v1::GetVideoRequest { name: name.clone(), ..Default::default() };
    let delete = || v1::DeleteVideoRequest { name: name.clone() };
    let model = || v1::GetModelRequest { name: done.model.clone(), ..Default::default() };
    let download = || v1::DownloadTraceRequest { name: done.trace.clone() };
    let refused = [
        service.videos().get_video(of("lab-b", get())).await.unwrap_err(),
        service.reasoning().simulate(of("lab-b", simulate())).await.unwrap_err(),
        service.models().get_model(of("lab-b", model())).await.unwrap_err(),
        service.traces().download_trace(of("lab-b", download())).await.unwrap_err(),
        service.videos().delete_video(of("lab-b", delete())).await.unwrap_err(),
    ];
    for status in refused {
        assert_eq!(status.code(), Code::NotFound, "{status:?}");
    }
    let list = v1::ListVideosRequest::default;
    assert_eq!(service.videos().list_videos(of("lab-b", list())).await.unwrap().into_inner().videos, []);
    let traces = v1::ListTracesRequest::default;
    assert_eq!(service.traces().list_traces(of("lab-b", traces())).await.unwrap().into_inner().traces, []);

    // The same video of the other tenant is a separate one: deleting it leaves this one.
    service.videos().create_video(of("lab-b", post())).await.unwrap();
    service.reasoning().simulate(of("lab-b", simulate())).await.unwrap();
    assert_eq!(
        service.engine.fits_run(),
        2,
        "nobody learns from the time that an answer takes who has asked"
    );
    service.videos().delete_video(of("lab-b", delete())).await.unwrap();
    service.videos().get_video(of("lab-a", get())).await.unwrap();
    service.traces().download_trace(of("lab-a", download())).await.unwrap();
    let listed = service.traces().list_traces(of("lab-a", traces())).await.unwrap().into_inner().traces;
    assert_eq!(listed.len(), 2, "a fit's and a simulation's: {listed:?}");
    service.stop().await;
}

/// A certificate authority that signs certificates for `localhost`.
struct Authority(CertifiedIssuer<'static, KeyPair>);

impl Authority {
    fn new() -> Authority {
        let mut params = CertificateParams::new(vec![]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        Authority(CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap())
    }

    fn certificate(&self) -> Certificate {
        Certificate::from_pem(self.0.pem())
    }

    /// A certificate and its key.
    fn pair(&self) -> (String, String) {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new(vec!["localhost".into()]).unwrap();
        let signed = params.signed_by(&key, &self.0).unwrap();
        (signed.pem(), key.serialize_pem())
    }

    fn signs(&self) -> Identity {
        let (certificate, key) = self.pair();
        Identity::from_pem(certificate, key)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn tls_accepts_clients_with_a_certificate_of_the_authority() {
    let folder = tempfile::tempdir().unwrap();
    let (ours, other) = (Authority::new(), Authority::new());
    let (certificate, key) = ours.pair();
    let tls = Tls::from_pem(&certificate, &key, Some(&ours.0.pem())).unwrap();
    let security = Security { tls: Some(tls), tokens: None };
    let mut address = String::new();
    let trusting = |authority: &Authority| {
        ClientTlsConfig::new().ca_certificate(authority.certificate()).domain_name("localhost")
    };
    let service = start_secured(folder.path(), CAPACITY, security, |url| {
        address = url.replace("http://", "https://");
        plainly(address.clone()).tls_config(trusting(&ours).identity(ours.signs())).unwrap()
    })
    .await;
    service.create(video("over TLS", 20)).await.unwrap();
    let refused = [
        plainly(address.replace("https://", "http://")),
        plainly(address.clone()).tls_config(trusting(&ours)).unwrap(),
        plainly(address.clone()).tls_config(trusting(&ours).identity(other.signs())).unwrap(),
        plainly(address.clone()).tls_config(trusting(&other).identity(ours.signs())).unwrap(),
    ];
    for (k, endpoint) in refused.into_iter().enumerate() {
        // With TLS 1.3 a client may see the refusal only at its first call.
        let let_in = match endpoint.connect().await {
            Ok(channel) => HealthClient::new(channel).check(HealthCheckRequest::default()).await.is_ok(),
            Err(_) => false,
        };
        assert!(!let_in, "client {k}");
    }
    service.create(video("still", 20)).await.unwrap();
    service.stop().await;
}

/// Makes certificates with the program itself.
fn certificates(folder: &Path) {
    let made = Command::new(env!("CARGO_BIN_EXE_vrdp"))
        .args(["certs", "--host", "localhost", "--out"])
        .arg(folder)
        .output()
        .unwrap();
    assert!(made.status.success(), "{made:?}");
}

/// A new connection that trusts the authority of a folder.
async fn connected(service: &BothPorts, folder: &Path) -> Result<Channel, tonic::transport::Error> {
    let authority = std::fs::read_to_string(folder.join("ca.pem")).unwrap();
    let trusting =
        ClientTlsConfig::new().ca_certificate(Certificate::from_pem(authority)).domain_name("localhost");
    plainly(format!("https://{}", service.grpc)).tls_config(trusting)?.connect().await
}

async fn list(channel: &Channel, lab: &str) -> Result<(), Code> {
    let asked = of(lab, v1::ListVideosRequest::default());
    let listed = VideosClient::new(channel.clone()).list_videos(asked).await;
    listed.map(|_| ()).map_err(|status| status.code())
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_and_certificates_change_without_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("old"), folder.path().join("new"));
    certificates(&old);
    certificates(&new);
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    for name in ["cert.pem", "key.pem"] {
        std::fs::copy(old.join(name), file(name)).unwrap();
    }
    std::fs::write(file("tokens"), TOKENS).unwrap();
    let (certificate, key, tokens) = (file("cert.pem"), file("key.pem"), file("tokens"));
    let settings =
        [("VRDP_TLS_CERT", certificate.as_str()), ("VRDP_TLS_KEY", &key), ("VRDP_TOKENS", &tokens)];
    let mut service = BothPorts::start(&folder.path().join("data"), &settings);
    let channel = connected(&service, &old).await.unwrap();
    assert_eq!((list(&channel, "lab-a").await, list(&channel, "lab-b").await), (Ok(()), Ok(())));

    // A file that cannot be read changes nothing.
    std::fs::write(&tokens, "nonsense").unwrap();
    service.logged("the old ones hold on");
    assert_eq!(list(&channel, "lab-a").await, Ok(()));
    // A revoked token is refused on the open connection, and a new one is taken.
    std::fs::write(&tokens, "secret-of-lab-b-00 = lab-b\nsecret-of-lab-c-00 = lab-c").unwrap();
    service.logged("were read again");
    assert_eq!(list(&channel, "lab-a").await, Err(Code::Unauthenticated));
    assert_eq!((list(&channel, "lab-b").await, list(&channel, "lab-c").await), (Ok(()), Ok(())));

    for name in ["cert.pem", "key.pem"] {
        std::fs::copy(new.join(name), file(name)).unwrap();
    }
    service.signal("HUP");
    let renewed = loop {
        match connected(&service, &new).await {
            Ok(renewed) => break renewed,
            Err(_) => tokio::time::sleep(std::time::Duration::from_millis(50)).await,
        }
    };
    assert!(connected(&service, &old).await.is_err(), "the old certificate is still shown");
    assert_eq!((list(&renewed, "lab-b").await, list(&channel, "lab-b").await), (Ok(()), Ok(())));
    assert!(service.is_running());
    service.signal("TERM");
    assert_eq!(service.ended(), Some(0));
}

#[tokio::test(flavor = "multi_thread")]
async fn every_call_has_one_line_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    std::fs::write(&tokens, TOKENS).unwrap();
    let settings = [("VRDP_TOKENS", tokens.to_str().unwrap()), ("VRDP_LOG", "info")];
    let mut service = BothPorts::start(&folder.path().join("data"), &settings);
    let channel = plainly(format!("http://{}", service.grpc)).connect().await.unwrap();
    let mut asked = of("lab-a", v1::ListVideosRequest::default());
    asked.metadata_mut().insert("x-request-id", "mine-7".parse().unwrap());
    VideosClient::new(channel.clone()).list_videos(asked).await.unwrap();
    let long = "x".repeat(100_000);
    let post = v1::CreateVideoRequest { request_id: long.clone(), ..Default::default() };
    let refused = VideosClient::new(channel.clone()).create_video(of("lab-b", post)).await.unwrap_err();
    assert_eq!(fields(&refused), ["request_id"]);
    let health = HealthCheckRequest::default();
    HealthClient::new(channel.clone()).check(health).await.unwrap();
    drop(channel);
    service.signal("TERM");
    assert_eq!(service.ended(), Some(0));
    service.logged("stopped");
    let log = service.log();
    let lines: Vec<&str> = log.lines().filter(|line| line.contains("call ended")).collect();
    let one =
        |words: &[&str]| lines.iter().filter(|line| words.iter().all(|word| line.contains(word))).count();
    let words = ["vrdp.v1.Videos/ListVideos", "mine-7", "code=\"Ok\"", "seconds=", "tenant=\"lab-a\""];
    assert_eq!(one(&words), 1, "{log}");
    assert_eq!(one(&["CreateVideo", "code=\"InvalidArgument\"", "tenant=\"lab-b\""]), 1, "{log}");
    assert!(lines.len() == 2 && log.contains("draining") && !log.contains(&long[..1000]), "{log}");
}
