//! The way to a service elsewhere: its URL, whom to trust, and how it knows us.

use super::Target;
use super::error::Failure;
use std::error::Error;
use std::fmt::Display;
use std::net::IpAddr;
use std::path::Path;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{self, Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Request, Status};

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

pub type Wire = InterceptedService<Channel, Bearer>;

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
        Some("http") => {}
        _ => return Err(wrong(&"the protocol is missing or unknown")),
    }
    let bearer = Bearer(target.token.as_deref().map(token).transpose()?);
    let lost = |e| Failure::other(format!("{url}: {}; is the service running?", cause(&e)));
    Ok(InterceptedService::new(endpoint.connect().await.map_err(lost)?, bearer))
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
