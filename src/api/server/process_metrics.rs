//! Metrics of the process under the names that Prometheus' own clients use. They come from `/proc`; elsewhere there are none.

use std::fmt::Write;
use std::fs::{read_dir, read_to_string};

/// Clock ticks in a second: Linux has reported 100 to programs on every processor for decades.
const TICKS_PER_SECOND: f64 = 100.0;
/// Open files that are assumed where the limit is not known: the smallest default of a system.
const USUAL_FILES: u64 = 256;

/// The names.
#[cfg(test)]
pub const PROCESS_METRICS: [&str; 6] = [
    "process_cpu_seconds_total",
    "process_resident_memory_bytes",
    "process_virtual_memory_bytes",
    "process_open_fds",
    "process_max_fds",
    "process_start_time_seconds",
];

/// In Prometheus' text format.
pub fn process_metrics() -> String {
    let mut text = String::new();
    let mut add = |name: &str, kind: &str, meaning: &str, value: Option<f64>| {
        if let Some(value) = value {
            // Writing to a string does not fail.
            let _ = write!(text, "# HELP {name} {meaning}\n# TYPE {name} {kind}\n{name} {value}\n\n");
        }
    };
    let stat = read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program may hold spaces; it ends with the last bracket.
    let fields: Vec<f64> = match stat.rsplit_once(')') {
        Some((_, rest)) => rest.split_whitespace().skip(1).map(|f| f.parse().unwrap_or(f64::NAN)).collect(),
        None => vec![],
    };
    // Numbers of the fields as in proc(5); these begin with the fourth.
    let field = |number: usize| fields.get(number - 4).copied();
    let cpu = field(14).zip(field(15)).map(|(user, system)| (user + system) / TICKS_PER_SECOND);
    let started = boot_time().zip(field(22)).map(|(boot, ticks)| boot + ticks / TICKS_PER_SECOND);
    add("process_cpu_seconds_total", "counter", "CPU time of the process (s)", cpu);
    let resident = kilobytes("VmRSS:");
    add("process_resident_memory_bytes", "gauge", "Resident memory (bytes)", resident);
    add("process_virtual_memory_bytes", "gauge", "Virtual memory (bytes)", field(23));
    let open = read_dir("/proc/self/fd").ok().map(|files| files.count() as f64);
    add("process_open_fds", "gauge", "Open files and connections", open);
    add("process_max_fds", "gauge", "Most open files and connections", file_limit().map(|most| most as f64));
    add("process_start_time_seconds", "gauge", "When the process started (s after 1970)", started);
    text
}

fn boot_time() -> Option<f64> {
    let stat = read_to_string("/proc/stat").ok()?;
    stat.lines().find_map(|line| line.strip_prefix("btime "))?.trim().parse().ok()
}

fn kilobytes(name: &str) -> Option<f64> {
    let status = read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix(" kB")?.trim().parse().ok().map(|kilobytes: f64| 1024.0 * kilobytes)
}

fn file_limit() -> Option<u64> {
    let limits = read_to_string("/proc/self/limits").ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Most files and connections that this process may have open.
pub fn max_open_files() -> u64 {
    file_limit().unwrap_or(USUAL_FILES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn every_metric_of_the_process_has_a_number() {
        let text = process_metrics();
        for name in PROCESS_METRICS {
            let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
            let value: f64 = line.unwrap_or_else(|| panic!("no {name} in {text}")).parse().unwrap();
            // A young process may have used no CPU time that can be counted.
            assert!(value > 0.0 || name == "process_cpu_seconds_total", "{name} is {value}");
        }
    }
}
