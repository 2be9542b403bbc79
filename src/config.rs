//! Settings: flags override the environment (`VRDP_`), which overrides a file, which overrides defaults. Unknown keys are
//! refused.

mod certificate;
mod reload;

use crate::api::{PortLimits, ReadinessLimits, Security, ServerLimits, Tls, TlsError, Tokens};
use crate::engine::{Capacity, ChatSettings, Quota, Retention};
use figment::Figment;
use figment::providers::{Env, Format, Serialized};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

pub use certificate::{NO_AUTHORITY, certificate_problem, is_authority, key_problem, pem_text};
pub use reload::reload_security;

/// How much later than the engine's limit the server ends a call: the error of the engine says more.
const TIMEOUT_MARGIN: Duration = Duration::from_secs(10);
/// The longest limit of a job (s): a year, as good as none.
const LONGEST_TIMEOUT_S: u64 = 365 * 86_400;
/// Longest wait for a language model's program (s).
const PARSER_TIMEOUT_S: u64 = 30;
/// Space for some deletions: each writes a few pages, and the map of free pages of a database of some 10 GiB.
const RESERVE_BYTES: u64 = 16 << 20;
/// Bytes in flight of a command that runs the service by itself: its own memory is the limit.
const OWN_BYTES: usize = 1 << 30;
/// The default address of the HTTP port.
pub const DEFAULT_HTTP: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8080);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Address of the gRPC service; a name is resolved once, at the start.
    #[serde(deserialize_with = "resolved")]
    pub listen: SocketAddr,
    /// Address of the HTTP port for metrics and reports; empty: none.
    #[serde(deserialize_with = "resolved_or_none", serialize_with = "or_empty")]
    pub http: Option<SocketAddr>,
    /// Serve beyond loopback although not everything is encrypted and authenticated.
    pub insecure: bool,
    /// Host names, with commas, under which the HTTP port may be opened, beside `localhost` and addresses.
    pub http_hosts: String,
    /// PEM files, for both ports: the certificate chain and its key; with an authority, clients need a certificate that it signed.
    pub tls_cert: Option<PathBuf>,
    pub tls_key: Option<PathBuf>,
    pub tls_client_ca: Option<PathBuf>,
    /// Lines of TOKEN = TENANT. Callers then need a token and see the data of its tenant only.
    pub tokens: Option<PathBuf>,
    /// The data folder; only one process may use it.
    pub data_dir: PathBuf,
    /// CPU threads.
    pub workers: usize,
    /// Jobs that may wait for a CPU thread.
    pub queue: usize,
    /// Longest duration of one job (s), its waiting time included.
    pub request_timeout_s: u64,
    /// Older traces (s since they were stored) are removed; 0: none.
    pub trace_max_age_s: u64,
    /// Most bytes of the traces of one tenant; beyond it its oldest are removed; 0: no limit.
    pub trace_max_bytes: u64,
    /// Most bytes of videos that one tenant may store; 0: no limit.
    pub tenant_video_bytes: u64,
    /// Most bytes of traces that one tenant may store; 0: no limit.
    pub tenant_trace_bytes: u64,
    /// Bytes of the disk that are kept back, so that deletions work when it is full; 0: none.
    pub reserve_bytes: u64,
    /// Most connections of each port; 0: as many as the limit of open files leaves room for.
    pub connections: usize,
    /// Bytes of requests that arrive or wait; decoded, they take about four times as much memory.
    pub request_bytes: usize,
    /// Bytes of replies that are not sent yet.
    pub reply_bytes: usize,
    /// The service is not ready while the disk of the data folder has fewer free bytes.
    pub min_free_bytes: u64,
    /// The service is not ready while its oldest queued job has waited longer (s).
    pub max_wait_s: u64,
    /// Filter, such as `info` or `vrdp=debug`.
    pub log: String,
    pub log_json: bool,
    /// URL of a collector of spans (OTLP over gRPC); empty: none. Only in a build with the feature `otlp`.
    pub otlp: String,
    /// A language model for questions that our reader does not understand; in the environment `VRDP_PARSER__URL` and so on.
    pub parser: ParserConfig,
}

/// A language model behind OpenAI's chat interface, which then sees such questions and the names of the video's objects.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ParserConfig {
    /// Of the interface, such as `http://127.0.0.1:8000/v1`; empty: none.
    pub url: String,
    /// Name of the language model.
    pub model: String,
    /// File with the key that the endpoint wants.
    pub key_file: Option<PathBuf>,
    /// Longest wait for one program (s); absent: 30.
    pub timeout_s: Option<u64>,
}

impl Default for Config {
    fn default() -> Self {
        let ports = PortLimits::default();
        Config {
            listen: SocketAddr::from(([127, 0, 0, 1], 50051)),
            http: Some(DEFAULT_HTTP),
            insecure: false,
            http_hosts: String::new(),
            tls_cert: None,
            tls_key: None,
            tls_client_ca: None,
            tokens: None,
            data_dir: "vrdp-data".into(),
            workers: std::thread::available_parallelism().map_or(1, |n| n.get()),
            queue: 256,
            request_timeout_s: 300,
            trace_max_age_s: 0,
            trace_max_bytes: 0,
            tenant_video_bytes: 0,
            tenant_trace_bytes: 0,
            reserve_bytes: RESERVE_BYTES,
            connections: 0,
            request_bytes: ports.request_bytes,
            reply_bytes: ports.reply_bytes,
            min_free_bytes: ports.readiness.free_bytes,
            max_wait_s: ports.readiness.oldest_wait.as_secs(),
            log: "info".into(),
            log_json: false,
            otlp: String::new(),
            parser: ParserConfig::default(),
        }
    }
}

/// Settings of the command line; `None` leaves a setting as it is.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Flags {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub listen: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub http: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub insecure: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data_dir: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls_cert: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls_key: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls_client_ca: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub workers: Option<usize>,
}

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("configuration: {}", described(.0))]
    Read(#[from] Box<figment::Error>),
    #[error("configuration file {0} does not exist")]
    NoFile(PathBuf),
    #[error("configuration: {key} is {value}; it must be {allowed}")]
    Range { key: &'static str, value: u64, allowed: &'static str },
    #[error(
        "{0} can be reached from other machines; give --tls-cert and --tls-key, and --tokens or --tls-client-ca, or \
         listen on loopback, or accept the risk with --insecure"
    )]
    Exposed(SocketAddr),
    #[error("configuration: {key} is given without {needs}")]
    Incomplete { key: &'static str, needs: &'static str },
    #[error("configuration: {key} {path}: {problem}")]
    File { key: &'static str, path: PathBuf, problem: String },
}

/// Reads `HOST:PORT`; of several addresses of a host an IPv4 one is preferred.
fn resolved<'de, D: Deserializer<'de>>(from: D) -> Result<SocketAddr, D::Error> {
    address(&String::deserialize(from)?)
}

fn resolved_or_none<'de, D: Deserializer<'de>>(from: D) -> Result<Option<SocketAddr>, D::Error> {
    let text = String::deserialize(from)?;
    if text.is_empty() { Ok(None) } else { address(&text).map(Some) }
}

fn or_empty<S: Serializer>(address: &Option<SocketAddr>, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&address.map(|a| a.to_string()).unwrap_or_default())
}

fn address<E: serde::de::Error>(text: &str) -> Result<SocketAddr, E> {
    let wrong = |why: String| E::custom(format!("is {text:?}: {why}; give HOST:PORT"));
    let found = text.to_socket_addrs().map_err(|e| wrong(e.to_string()))?;
    found.min_by_key(SocketAddr::is_ipv6).ok_or_else(|| wrong("no address found".into()))
}

/// TOML files, as figment reads them.
struct Toml;

impl Format for Toml {
    type Error = toml::de::Error;

    const NAME: &'static str = "TOML";

    fn from_str<T: DeserializeOwned>(text: &str) -> Result<T, toml::de::Error> {
        toml::from_str(text)
    }
}

/// Each error with its key and its file or variable, without positions in our source.
fn described(errors: &figment::Error) -> String {
    let one = |e: figment::Error| {
        let place = e.metadata.as_ref().and_then(|m| match &m.source {
            Some(figment::Source::File(path)) => Some(format!(" (in {})", path.display())),
            _ => m.name.contains("environment").then(|| " (in the environment)".to_string()),
        });
        format!("{} {}{}", e.path.join("."), e.kind, place.unwrap_or_default()).trim().to_string()
    };
    errors.clone().into_iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Variables of settings. Three others with the same prefix name the service for the commands that call one.
fn environment() -> Env {
    Env::prefixed("VRDP_").ignore(&["server", "ca", "token"]).split("__")
}

/// The URL of a service on this machine with the settings of this environment (`VRDP_LISTEN`, `VRDP_TLS_CERT`).
pub fn local_service_url() -> Result<String, ConfigError> {
    let figment = Figment::from(Serialized::defaults(Config::default())).merge(environment());
    let config: Config = figment.extract().map_err(Box::new)?;
    let mut address = config.listen;
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
        _ => {}
    }
    let scheme = if config.tls_cert.is_some() { "https" } else { "http" };
    Ok(format!("{scheme}://{address}"))
}

impl Config {
    pub fn load(file: Option<&Path>, flags: Flags) -> Result<Config, ConfigError> {
        Config::default().overridden(file, flags)
    }

    /// The settings of a command that runs the service by itself: nobody else waits for its threads, so that a job ends only
    /// where the environment sets a limit.
    pub fn for_command(flags: Flags) -> Result<Config, ConfigError> {
        Config {
            request_timeout_s: LONGEST_TIMEOUT_S,
            request_bytes: OWN_BYTES,
            reply_bytes: OWN_BYTES,
            ..Config::default()
        }
        .overridden(None, flags)
    }

    /// These settings, those of the file, the environment and the flags on top.
    fn overridden(self, file: Option<&Path>, flags: Flags) -> Result<Config, ConfigError> {
        let mut figment = Figment::from(Serialized::defaults(self));
        if let Some(file) = file {
            if !file.is_file() {
                return Err(ConfigError::NoFile(file.to_path_buf()));
            }
            figment = figment.merge(Toml::file_exact(file));
        }
        let figment = figment.merge(environment()).merge(Serialized::defaults(flags));
        let config: Config = figment.extract().map_err(Box::new)?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> Result<(), ConfigError> {
        let within = |key, value: u64, low: u64, high: u64, allowed| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(ConfigError::Range { key, value, allowed })
            }
        };
        within("workers", self.workers as u64, 1, 1024, "1 to 1024")?;
        within("queue", self.queue as u64, 0, 100_000, "0 to 100000")?;
        within("request_timeout_s", self.request_timeout_s, 1, LONGEST_TIMEOUT_S, "1 to 31536000")?;
        within("connections", self.connections as u64, 0, 100_000, "0 to 100000")?;
        let request_limit = 2 * ServerLimits::default().request_bytes as u64;
        within("request_bytes", self.request_bytes as u64, request_limit, u64::MAX, "33554432 or more")?;
        let reply_limit = 2 * ServerLimits::default().reply_bytes as u64;
        within("reply_bytes", self.reply_bytes as u64, reply_limit, u64::MAX, "134217728 or more")?;
        within("max_wait_s", self.max_wait_s, 1, LONGEST_TIMEOUT_S, "1 to 31536000")?;
        for (key, given, needs, other) in [
            ("tls_cert", &self.tls_cert, "tls_key", &self.tls_key),
            ("tls_key", &self.tls_key, "tls_cert", &self.tls_cert),
            ("tls_client_ca", &self.tls_client_ca, "tls_cert", &self.tls_cert),
        ] {
            if given.is_some() && other.is_none() {
                return Err(ConfigError::Incomplete { key, needs });
            }
        }
        match self.exposed().first() {
            Some(exposed) if !self.insecure => Err(ConfigError::Exposed(*exposed)),
            _ => Ok(()),
        }
    }

    /// Whether everything is encrypted and every caller is known.
    fn is_secure(&self) -> bool {
        self.tls_cert.is_some() && (self.tokens.is_some() || self.tls_client_ca.is_some())
    }

    /// The addresses that other machines reach although not everything is encrypted and authenticated.
    pub fn exposed(&self) -> Vec<SocketAddr> {
        let addresses = [Some(self.listen), self.http].into_iter().flatten();
        addresses.filter(|address| !self.is_secure() && !address.ip().is_loopback()).collect()
    }

    pub fn capacity(&self) -> Capacity {
        let job_timeout = Duration::from_secs(self.request_timeout_s);
        Capacity { workers: self.workers, queue: self.queue, job_timeout }
    }

    pub fn retention(&self) -> Retention {
        let max_age = limit(self.trace_max_age_s).map(Duration::from_secs);
        Retention { max_age, max_bytes: limit(self.trace_max_bytes) }
    }

    /// The language model for questions that our reader does not understand, if there is one.
    pub fn parser(&self) -> Result<Option<ChatSettings>, ConfigError> {
        let ParserConfig { url, model, key_file, timeout_s } = &self.parser;
        match (url.is_empty(), model.is_empty()) {
            (true, true) => return Ok(None),
            (true, false) => {
                return Err(ConfigError::Incomplete { key: "parser.model", needs: "parser.url" });
            }
            (false, true) => {
                return Err(ConfigError::Incomplete { key: "parser.url", needs: "parser.model" });
            }
            (false, false) => {}
        }
        let key = match key_file {
            Some(path) => Some(read("parser.key_file", path)?.trim().to_string()),
            None => None,
        };
        let timeout = Duration::from_secs(timeout_s.unwrap_or(PARSER_TIMEOUT_S));
        Ok(Some(ChatSettings { url: url.clone(), model: model.clone(), key, timeout }))
    }

    pub fn quota(&self) -> Quota {
        Quota { video_bytes: limit(self.tenant_video_bytes), trace_bytes: limit(self.tenant_trace_bytes) }
    }

    /// Reads the files of certificates and tokens.
    pub fn security(&self) -> Result<Security, ConfigError> {
        let mut security = Security::default();
        if let (Some(cert), Some(key)) = (&self.tls_cert, &self.tls_key) {
            let certificate = checked("tls_cert", cert, certificate_problem)?;
            if is_authority(&certificate) {
                tracing::warn!(file = %cert.display(), "tls_cert: {NO_AUTHORITY}");
            }
            let key_text = checked("tls_key", key, key_problem)?;
            let authority = match &self.tls_client_ca {
                Some(ca) => Some((ca, checked("tls_client_ca", ca, certificate_problem)?)),
                None => None,
            };
            let pem = authority.as_ref().map(|(_, pem)| pem.as_str());
            let tls = Tls::from_pem(&certificate, &key_text, pem).map_err(|error| {
                let problem = error.to_string();
                match (error, &authority) {
                    (TlsError::Authority(_), Some((ca, _))) => {
                        ConfigError::File { key: "tls_client_ca", path: ca.to_path_buf(), problem }
                    }
                    _ => ConfigError::File { key: "tls_cert", path: cert.clone(), problem },
                }
            })?;
            security.tls = Some(tls);
        }
        if let Some(path) = &self.tokens {
            let wrong = |problem: String| ConfigError::File { key: "tokens", path: path.clone(), problem };
            let tokens = Tokens::parse(&read("tokens", path)?).map_err(|e| wrong(e.to_string()))?;
            security.tokens = Some(Arc::new(tokens));
        }
        Ok(security)
    }

    pub fn limits(&self) -> ServerLimits {
        ServerLimits { timeout: self.capacity().job_timeout + TIMEOUT_MARGIN, ..ServerLimits::default() }
    }

    /// Limits of both ports together.
    pub fn port_limits(&self) -> PortLimits {
        let usual = PortLimits::default();
        let hosts = self.http_hosts.split(',').map(str::trim).filter(|host| !host.is_empty());
        PortLimits {
            connections: if self.connections == 0 { usual.connections } else { self.connections },
            request_bytes: self.request_bytes,
            reply_bytes: self.reply_bytes,
            hosts: hosts.map(String::from).collect(),
            readiness: ReadinessLimits {
                free_bytes: self.min_free_bytes,
                oldest_wait: Duration::from_secs(self.max_wait_s),
            },
        }
    }
}

/// The limit that a setting means; 0: none.
fn limit(given: u64) -> Option<u64> {
    (given > 0).then_some(given)
}

/// The text of the file that a setting names.
fn read(key: &'static str, path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|e| ConfigError::File {
        key,
        path: path.into(),
        problem: e.to_string(),
    })
}

fn read_pem(key: &'static str, path: &Path) -> Result<String, ConfigError> {
    let wrong = |problem: String| ConfigError::File { key, path: path.into(), problem };
    pem_text(std::fs::read(path).map_err(|e| wrong(e.to_string()))?).map_err(|problem| wrong(problem.into()))
}

/// The text of a PEM file, if `problem` finds none.
fn checked(
    key: &'static str,
    path: &Path,
    problem: fn(&str) -> Option<&'static str>,
) -> Result<String, ConfigError> {
    let text = read_pem(key, path)?;
    match problem(&text) {
        Some(problem) => Err(ConfigError::File { key, path: path.into(), problem: problem.into() }),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(file: &str, flags: Flags, expected: Result<impl Fn(&Config) -> bool, &str>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("vrdp.toml");
        std::fs::write(&path, file).unwrap();
        match (Config::load(Some(&path), flags), expected) {
            (Ok(config), Ok(holds)) => assert!(holds(&config), "{config:?}"),
            (Err(error), Err(text)) => {
                let message = error.to_string();
                assert!(message.contains(text) && !message.contains(".rs"), "{message}");
            }
            (Ok(config), Err(text)) => panic!("{config:?} instead of {text}"),
            (Err(error), Ok(_)) => panic!("{error}"),
        }
    }

    #[test]
    fn a_file_that_is_no_certificate_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let made = rcgen::generate_simple_self_signed(["localhost".to_string()]).unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).unwrap();
            Some(folder.path().join(name))
        };
        let (cert, none) = (file("cert", &made.cert.pem()), file("none", "nothing"));
        let key = file("key", &made.signing_key.serialize_pem());
        let with = |tls_cert: &Option<PathBuf>, tls_client_ca: &Option<PathBuf>| {
            let [tls_cert, tls_client_ca, tls_key] = [tls_cert, tls_client_ca, &key].map(Clone::clone);
            Config { tls_cert, tls_key, tls_client_ca, ..Config::default() }
                .security()
                .map(|s| s.tls.is_some())
        };
        assert!(matches!(with(&cert, &cert), Ok(true)));
        let message = |wrong: Result<bool, ConfigError>| wrong.unwrap_err().to_string();
        assert!(message(with(&none, &cert)).contains("tls_cert"));
        assert!(message(with(&cert, &none)).contains("tls_client_ca"));
    }

    #[test]
    fn flags_override_the_file_and_wrong_values_are_refused() {
        type Never = fn(&Config) -> bool;
        let listen = |text: &str| Flags { listen: Some(text.into()), ..Flags::default() };
        check("queue = 3", Flags::default(), Ok(|c: &Config| c.queue == 3 && c.listen.port() == 50051));
        check("listen = '127.0.0.1:1'", listen("[::1]:2"), Ok(|c: &Config| c.listen.port() == 2));
        let name = listen("localhost:4");
        check("", name, Ok(|c: &Config| c.listen.ip().is_loopback() && c.listen.port() == 4));
        check("", listen("localhost"), Err::<Never, _>("listen is \"localhost\""));
        check("queue = 'x'", Flags::default(), Err::<Never, _>("vrdp.toml"));
        check("quue = 3", Flags::default(), Err::<Never, _>("quue"));
        check("workers = 0", Flags::default(), Err::<Never, _>("workers is 0"));
        check("", listen("0.0.0.0:1"), Err::<Never, _>("--insecure"));
        let http = |text: &str| Flags { http: Some(text.into()), ..Flags::default() };
        check("", Flags::default(), Ok(|c: &Config| c.http == Some(DEFAULT_HTTP)));
        check("http = '127.0.0.1:9'", Flags::default(), Ok(|c: &Config| c.http.unwrap().port() == 9));
        check("http = '127.0.0.1:9'", http(""), Ok(|c: &Config| c.http.is_none()));
        check("", http("0.0.0.0:1"), Err::<Never, _>("0.0.0.0:1"));
        let secured = "tls_cert = 'a'\ntls_key = 'b'\ntokens = 'c'";
        check(secured, http("0.0.0.0:1"), Ok(|c: &Config| c.exposed().is_empty()));
        check("request_bytes = 7", Flags::default(), Err::<Never, _>("request_bytes is 7"));
        let hosts =
            |c: &Config| c.port_limits().hosts == ["a.example", "b"] && c.port_limits().connections > 15;
        check("http_hosts = 'a.example, b'", Flags::default(), Ok(hosts));
        check("tls_cert = 'a'", Flags::default(), Err::<Never, _>("tls_key"));
        let tls = "tls_cert = 'a'\ntls_key = 'b'\n";
        check(tls, listen("0.0.0.0:1"), Err::<Never, _>("--tokens"));
        check(&format!("{tls}tokens = 'c'"), listen("0.0.0.0:1"), Ok(|c: &Config| c.security().is_err()));
        let open = Flags { insecure: Some(true), ..listen("0.0.0.0:1") };
        check("", open, Ok(|c: &Config| c.insecure));
    }

    #[test]
    fn a_command_without_a_service_has_no_hidden_deadline() {
        let local = Config::for_command(Flags::default()).expect("it is valid");
        assert!(local.request_timeout_s > 30 * 86_400, "{local:?}");
        assert_eq!(Config::load(None, Flags::default()).expect("it is valid").request_timeout_s, 300);
    }
}
