//! `certs`: makes an authority and a certificate of a service for trials.

use crate::cli::error::Failure;
use crate::cli::output::print;
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair, KeyUsagePurpose};
use std::fs::{OpenOptions, create_dir_all};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Who may read a private key: its owner.
const PRIVATE: u32 = 0o600;
const PUBLIC: u32 = 0o644;

#[derive(clap::Args)]
pub struct CertsArgs {
    /// Name or address under which clients call the service; may be repeated.
    #[arg(long, value_name = "NAME", required = true)]
    host: Vec<String>,
    /// Folder of the files, which must not exist yet: ca.pem, cert.pem and key.pem.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

pub fn run(args: &CertsArgs) -> Result<(), Failure> {
    let made = make(&args.host)?;
    create_dir_all(&args.out).map_err(|e| Failure::input(format!("--out {}: {e}", args.out.display())))?;
    let files = [
        ("ca.pem", &made.authority, PUBLIC),
        ("cert.pem", &made.chain, PUBLIC),
        ("key.pem", &made.key, PRIVATE),
    ];
    for (name, _, _) in &files {
        let path = args.out.join(name);
        if path.exists() {
            let problem =
                format!("{}: exists; remove it, or choose another folder with --out", path.display());
            return Err(Failure::input(problem));
        }
    }
    for (name, text, mode) in files {
        write(&args.out.join(name), text, mode)?;
    }
    let (folder, host) = (args.out.display(), args.host.first().map_or("localhost", String::as_str));
    print(&format!(
        "made {folder}/ca.pem, cert.pem and key.pem: for trials, as the key of their authority was not kept\n\
         service: vrdp serve --tls-cert {folder}/cert.pem --tls-key {folder}/key.pem --tokens FILE\n\
         clients: vrdp COMMAND --server https://{host}:50051 --ca {folder}/ca.pem --token FILE\n"
    ))
}

/// In PEM.
struct Made {
    authority: String,
    chain: String,
    key: String,
}

fn make(hosts: &[String]) -> Result<Made, Failure> {
    let wrong = |e: rcgen::Error| Failure::input(format!("--host {}: {e}", hosts.join(" --host ")));
    let named = |mut params: CertificateParams, name: &str| {
        params.distinguished_name.push(DnType::CommonName, name);
        params
    };
    let mut params = named(CertificateParams::new(vec![]).map_err(wrong)?, "vrdp, authority for trials");
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let authority =
        CertifiedIssuer::self_signed(params, KeyPair::generate().map_err(wrong)?).map_err(wrong)?;
    let key = KeyPair::generate().map_err(wrong)?;
    let mut params = named(CertificateParams::new(hosts.to_vec()).map_err(wrong)?, "vrdp, for trials");
    params.is_ca = IsCa::ExplicitNoCa;
    params.use_authority_key_identifier_extension = true;
    let certificate = params.signed_by(&key, &authority).map_err(wrong)?;
    Ok(Made { authority: authority.pem(), chain: certificate.pem(), key: key.serialize_pem() })
}

fn write(path: &Path, text: &str, mode: u32) -> Result<(), Failure> {
    let wrong = |e: std::io::Error| Failure::other(format!("{}: {e}", path.display()));
    let mut file = OpenOptions::new().write(true).create_new(true).mode(mode).open(path).map_err(wrong)?;
    file.write_all(text.as_bytes()).map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::Tls;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn the_files_serve_and_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let args =
            CertsArgs { host: vec!["localhost".into(), "127.0.0.1".into()], out: folder.path().join("made") };
        run(&args).unwrap();
        let read = |name: &str| std::fs::read_to_string(args.out.join(name)).unwrap();
        Tls::from_pem(&read("cert.pem"), &read("key.pem"), Some(&read("ca.pem"))).unwrap();
        assert!(Tls::from_pem(&read("ca.pem"), &read("key.pem"), None).is_err());
        let mode = std::fs::metadata(args.out.join("key.pem")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, PRIVATE);
        assert!(run(&args).unwrap_err().to_string().contains("exists"));
        let wrong = CertsArgs { host: vec!["näme".into()], out: folder.path().join("other") };
        assert!(run(&wrong).unwrap_err().to_string().contains("--host"));
    }
}
