//! Certificates of the service and the authority of its clients, as both ports use them.

use rustls_pki_types::pem::PemObject;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use std::sync::Arc;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{Error, InconsistentKeys, RootCertStore, ServerConfig};

/// Encryption of both ports with one certificate.
#[derive(Clone)]
pub struct Tls {
    pub(in crate::api) grpc: Arc<ServerConfig>,
    /// Health and metrics need no certificate of the client; what else is shown asks for it later.
    pub(in crate::api) http: Arc<ServerConfig>,
    /// Whether clients need a certificate.
    pub(in crate::api) needs_certificate: bool,
}

/// Why certificates cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// Of the certificate or its key.
    #[error("{0}")]
    Identity(String),
    /// Of the authority that signs clients' certificates.
    #[error("{0}")]
    Authority(String),
}

impl Tls {
    /// A certificate chain, its key, and the authority of clients if they need a certificate; all in PEM.
    pub fn from_pem(chain: &str, key: &str, authority: Option<&str>) -> Result<Tls, TlsError> {
        let config = |optional: bool, protocol: &[u8]| {
            let identity = |error: Error| TlsError::Identity(words(&error));
            let provider = Arc::new(default_provider());
            let builder = ServerConfig::builder_with_provider(provider.clone())
                .with_safe_default_protocol_versions()
                .map_err(identity)?;
            let builder = match authority {
                None => builder.with_no_client_auth(),
                Some(pem) => {
                    let verifier = WebPkiClientVerifier::builder_with_provider(roots(pem)?, provider);
                    let verifier = if optional { verifier.allow_unauthenticated() } else { verifier };
                    let verifier = verifier.build().map_err(|e| TlsError::Authority(e.to_string()))?;
                    builder.with_client_cert_verifier(verifier)
                }
            };
            let wrong = |error: rustls_pki_types::pem::Error| TlsError::Identity(error.to_string());
            let chain: Vec<CertificateDer> =
                CertificateDer::pem_slice_iter(chain.as_bytes()).collect::<Result<_, _>>().map_err(wrong)?;
            let key = PrivateKeyDer::from_pem_slice(key.as_bytes()).map_err(wrong)?;
            let mut config = builder.with_single_cert(chain, key).map_err(identity)?;
            config.alpn_protocols.push(protocol.to_vec());
            Ok(Arc::new(config))
        };
        Ok(Tls {
            grpc: config(false, b"h2")?,
            http: config(true, b"http/1.1")?,
            needs_certificate: authority.is_some(),
        })
    }
}

fn roots(pem: &str) -> Result<Arc<RootCertStore>, TlsError> {
    let wrong = |why: String| TlsError::Authority(why);
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_slice_iter(pem.as_bytes()) {
        let certificate = certificate.map_err(|e| wrong(e.to_string()))?;
        roots.add(certificate).map_err(|e| wrong(e.to_string()))?;
    }
    Ok(Arc::new(roots))
}

fn words(error: &Error) -> String {
    match error {
        Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
            "is not the certificate of tls_key; give a certificate and the key it was made with".into()
        }
        other => other.to_string(),
    }
}
