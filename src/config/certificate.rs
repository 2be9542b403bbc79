//! Words for files of certificates and keys that cannot be used as they are.

use rustls_pki_types::CertificateDer;
use rustls_pki_types::pem::PemObject;

/// In DER: the extension of basic constraints, whether it is critical, and that the certificate is an authority's.
const BASIC_CONSTRAINTS: [u8; 5] = [0x06, 0x03, 0x55, 0x1d, 0x13];
const IS_CRITICAL: [u8; 3] = [0x01, 0x01, 0xff];
const IS_AUTHORITY: [u8; 3] = [0x01, 0x01, 0xff];
/// How to make a certificate of a service, for messages.
pub const NO_AUTHORITY: &str = "it is an authority's certificate (CA:TRUE), which clients refuse for a service; make it again \
                                with -addext basicConstraints=critical,CA:FALSE";

/// The text of a PEM file, or what it is instead.
pub fn pem_text(bytes: Vec<u8>) -> Result<String, &'static str> {
    let is_der = bytes.starts_with(&[0x30, 0x82]) || bytes.starts_with(&[0x30, 0x81]);
    String::from_utf8(bytes).map_err(|_| match is_der {
        true => "is DER, not PEM; convert it: openssl x509 (for a key: openssl pkey) -inform der -in FILE -out FILE.pem",
        false => "is no PEM file; convert it with openssl (-outform pem)",
    })
}

/// Why a text is no certificate.
pub fn certificate_problem(pem: &str) -> Option<&'static str> {
    match pem {
        _ if pem.contains("-----BEGIN CERTIFICATE-----") => None,
        _ if pem.contains("PRIVATE KEY-----") => {
            Some("holds a private key, but no certificate; give the file of the certificate here")
        }
        _ if pem.contains("CERTIFICATE REQUEST-----") => {
            Some("is a request for a certificate; sign it: openssl x509 -req -in FILE -CA ... -out c.pem")
        }
        _ => Some("holds no certificate; give a PEM file with -----BEGIN CERTIFICATE-----"),
    }
}

/// Why a text is no private key that can be used.
pub fn key_problem(pem: &str) -> Option<&'static str> {
    if pem.contains("ENCRYPTED") {
        Some("is encrypted with a passphrase; write it without: openssl pkey -in FILE -out plain.pem")
    } else if pem.contains("PRIVATE KEY-----") {
        None
    } else if pem.contains("-----BEGIN CERTIFICATE-----") {
        Some("holds a certificate, but no private key; give the file of the key here")
    } else {
        Some("holds no private key; give a PEM file with -----BEGIN PRIVATE KEY-----")
    }
}

/// Whether the first certificate of a PEM file is that of an authority.
pub fn is_authority(pem: &str) -> bool {
    let Ok(certificate) = CertificateDer::from_pem_slice(pem.as_bytes()) else { return false };
    let der = certificate.as_ref();
    let Some(at) = der.windows(BASIC_CONSTRAINTS.len()).position(|window| window == BASIC_CONSTRAINTS) else {
        return false;
    };
    let rest = der.get(at + BASIC_CONSTRAINTS.len()..).unwrap_or_default();
    let rest = rest.strip_prefix(&IS_CRITICAL).unwrap_or(rest);
    // An octet string with a sequence that begins with the flag.
    matches!(rest, [0x04, _, 0x30, _, flag @ ..] if flag.starts_with(&IS_AUTHORITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_authoritys_certificate_is_recognised() {
        let made = |is_ca| {
            let key = rcgen::KeyPair::generate().unwrap();
            let mut params = rcgen::CertificateParams::new(vec!["localhost".to_string()]).unwrap();
            params.is_ca = is_ca;
            params.self_signed(&key).unwrap().pem()
        };
        let authority = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
        assert!(is_authority(&made(authority)));
        assert!(!is_authority(&made(rcgen::IsCa::ExplicitNoCa)) && !is_authority(&made(rcgen::IsCa::NoCa)));
        assert!(!is_authority("nothing"));
    }

    #[test]
    fn files_that_are_something_else_are_named() {
        assert!(pem_text(vec![0x30, 0x82, 0xff, 0xfe]).unwrap_err().starts_with("is DER"));
        assert!(pem_text(vec![0xff, 0xfe]).unwrap_err().starts_with("is no PEM"));
        let key = "-----BEGIN PRIVATE KEY-----\n";
        let certificate = "-----BEGIN CERTIFICATE-----\n";
        assert!(certificate_problem(key).is_some_and(|why| why.contains("holds a private key")));
        assert!(key_problem(certificate).is_some_and(|why| why.contains("holds a certificate")));
        assert!(
            key_problem("-----BEGIN ENCRYPTED PRIVATE KEY-----")
                .is_some_and(|why| why.contains("passphrase"))
        );
        assert_eq!([certificate_problem(certificate), key_problem(key)], [None; 2]);
    }
}
