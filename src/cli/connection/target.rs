//! The options of all commands: which service is used, and how it is reached.

use std::ffi::OsString;
use std::path::PathBuf;

/// Options of all commands.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Options of all commands")]
pub struct Target {
    /// URL of a running service, such as http://127.0.0.1:50051 [default: VRDP_SERVER, or a service inside this process]
    #[arg(long, global = true, value_name = "URL")]
    pub server: Option<String>,
    /// Folder of the store [default: a temporary folder; for `serve`: vrdp-data]
    #[arg(long, global = true, value_name = "DIR")]
    pub data_dir: Option<PathBuf>,
    /// Certificate of the authority that signed the service's certificate (PEM) [default: VRDP_CA, or the authorities of this system]
    #[arg(long, global = true, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Client certificate (PEM); needs --key.
    #[arg(long, global = true, value_name = "FILE")]
    pub cert: Option<PathBuf>,
    /// Private key of --cert (PEM).
    #[arg(long, global = true, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// File with the access token of a tenant [default: VRDP_TOKEN]
    #[arg(long, global = true, value_name = "FILE")]
    pub token: Option<PathBuf>,
    /// CPU threads of the service inside this process [default: one for each core]; results do not depend on it
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// Shows results only, no progress.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

impl Target {
    /// The flag and the value that name the same service in another command; without one, a data folder to begin with.
    pub fn words(&self) -> [String; 2] {
        match (&self.server, &self.data_dir) {
            (Some(url), _) => ["--server".into(), url.clone()],
            (None, Some(folder)) => ["--data-dir".into(), folder.display().to_string()],
            (None, None) => ["--data-dir".into(), "lab".into()],
        }
    }

    /// Whether results remain after the command has ended.
    pub fn keeps_results(&self) -> bool {
        self.server.is_some() || self.data_dir.is_some()
    }

    /// Takes from the environment what no flag says, unless --data-dir asks for a service inside this process.
    pub fn or_environment(mut self, variable: impl Fn(&str) -> Option<OsString>) -> Target {
        if self.data_dir.is_some() {
            return self;
        }
        let given = |name| variable(name).filter(|value| !value.is_empty());
        self.server =
            self.server.or_else(|| given("VRDP_SERVER").map(|url| url.to_string_lossy().into_owned()));
        if self.server.is_some() {
            self.ca = self.ca.or_else(|| given("VRDP_CA").map(PathBuf::from));
            self.token = self.token.or_else(|| given("VRDP_TOKEN").map(PathBuf::from));
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_go_before_the_environment() {
        let found = |target: Target| {
            let set = |name: &str| Some(OsString::from(format!("of {name}")));
            let Target { server, ca, token, .. } = target.or_environment(set);
            (server, ca.map(|f| f.display().to_string()), token.map(|f| f.display().to_string()))
        };
        let all = (Some("of VRDP_SERVER".into()), Some("of VRDP_CA".into()), Some("of VRDP_TOKEN".into()));
        assert_eq!(found(Target::default()), all);
        let named = Target { server: Some("url".into()), ca: Some("file".into()), ..Target::default() };
        assert_eq!(found(named), (Some("url".into()), Some("file".into()), all.2));
        assert_eq!(found(Target { data_dir: Some("lab".into()), ..Target::default() }), (None, None, None));
    }
}
