//! The program with both ports, its log, and signals.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

pub struct BothPorts {
    child: Child,
    /// `HOST:PORT` of gRPC and of HTTP.
    pub grpc: String,
    pub http: String,
    log: Arc<Mutex<Vec<String>>>,
}

impl BothPorts {
    /// Starts the program with settings in its environment; it accepts calls when this returns.
    pub fn start(data: &Path, settings: &[(&str, &str)]) -> BothPorts {
        let mut child = Command::new(env!("CARGO_BIN_EXE_vrdp"))
            .args(["serve", "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0", "--data-dir"])
            .arg(data)
            .env_remove("VRDP_LONG_TESTS")
            .envs(settings.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = Arc::new(Mutex::new(vec![]));
        let (lines, written) = (BufReader::new(child.stderr.take().unwrap()), log.clone());
        std::thread::spawn(move || {
            lines.lines().map_while(Result::ok).for_each(|l| written.lock().unwrap().push(l))
        });
        let mut announced = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut address = || {
            let line = announced.next().and_then(Result::ok);
            let line = line.unwrap_or_else(|| panic!("it does not serve: {:?}", log.lock().unwrap()));
            line.rsplit(['/', ' ']).next().unwrap().to_string()
        };
        let (grpc, http) = (address(), address());
        BothPorts { child, grpc, http, log }
    }

    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.unwrap().success());
    }

    /// Waits for its end; returns the exit status.
    pub fn ended(&mut self) -> Option<i32> {
        self.child.wait().unwrap().code()
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    pub fn log(&self) -> String {
        self.log.lock().unwrap().join("\n")
    }

    /// Waits until the log holds a text.
    pub fn logged(&self, text: &str) {
        for _ in 0..600 {
            if self.log().contains(text) {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        panic!("no {text:?} in {}", self.log());
    }

    /// A value of its status, such as `VmRSS:` (MiB).
    pub fn memory(&self, name: &str) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1024.0
    }
}

impl Drop for BothPorts {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
