//! The metrics of the process for Prometheus: names, meanings and buckets.

use crate::api::DESCRIPTORS;
use crate::engine::{Engine, metric_names};
use metrics::{Unit, describe_counter, describe_gauge, describe_histogram, gauge};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use prost::Message;
use std::collections::BTreeSet;
use std::sync::OnceLock;

pub const CALLS: &str = "vrdp_calls_total";
pub const CALL_SECONDS: &str = "vrdp_call_seconds";

/// Seconds: from a cached answer to the longest discovery.
const BUCKETS: [f64; 16] =
    [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 300.0];

static RECORDER: OnceLock<Option<PrometheusHandle>> = OnceLock::new();

/// Installs the recorder, once a process; earlier events are not counted.
pub fn install() {
    RECORDER.get_or_init(|| {
        let builder = PrometheusBuilder::new().set_buckets(&BUCKETS);
        let installed = builder.and_then(PrometheusBuilder::install_recorder);
        if let Err(error) = &installed {
            tracing::error!(%error, "no metrics");
        }
        describe();
        installed.ok()
    });
}

fn describe() {
    describe_counter!(
        CALLS,
        "Calls that ended, by method and code; Cancelled: the caller left or its deadline passed"
    );
    describe_histogram!(CALL_SECONDS, Unit::Seconds, "Duration of calls, to the end of their streams");
    for (name, meaning) in metric_names::COUNTERS {
        describe_counter!(name, meaning);
    }
    for (name, meaning) in metric_names::HISTOGRAMS {
        describe_histogram!(name, Unit::Seconds, meaning);
    }
    for (name, meaning) in metric_names::GAUGES {
        describe_gauge!(name, meaning);
    }
}

/// All metrics in Prometheus' text format; empty without a recorder.
pub fn render(engine: &Engine) -> String {
    let Some(Some(recorder)) = RECORDER.get() else { return String::new() };
    let load = engine.load();
    gauge!(metric_names::WAITING).set(load.waiting as f64);
    gauge!(metric_names::RUNNING).set(load.running as f64);
    gauge!(metric_names::OLDEST_WAIT).set(load.oldest.as_secs_f64());
    if let Some(free) = engine.storage().free_bytes {
        gauge!(metric_names::FREE_BYTES).set(free as f64);
    }
    recorder.render()
}

/// Empties the buffers of the histograms; to be called every few seconds.
pub fn upkeep() {
    if let Some(Some(recorder)) = RECORDER.get() {
        recorder.run_upkeep();
    }
}

/// The paths of all methods (`/vrdp.v1.Videos/GetVideo`); other paths of a request never become a label.
pub fn methods() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for bytes in [DESCRIPTORS, tonic_health::pb::FILE_DESCRIPTOR_SET] {
        let Ok(set) = prost_types::FileDescriptorSet::decode(bytes) else { continue };
        for file in set.file {
            for service in &file.service {
                let path = |m: &prost_types::MethodDescriptorProto| {
                    format!("/{}.{}/{}", file.package(), service.name(), m.name())
                };
                found.extend(service.method.iter().map(path));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dashboard_uses_metrics_that_exist() {
        let names = [CALLS, CALL_SECONDS].into_iter();
        let names = names.chain(metric_names::COUNTERS.map(|(name, _)| name));
        let names = names.chain(metric_names::HISTOGRAMS.map(|(name, _)| name));
        let known: BTreeSet<&str> = names.chain(metric_names::GAUGES.map(|(name, _)| name)).collect();
        let dashboard = include_str!("../../../deploy/grafana/dashboards/vrdp.json");
        let words = dashboard.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let used: BTreeSet<&str> =
            words.filter(|w| w.starts_with("vrdp_")).map(|w| w.trim_end_matches("_bucket")).collect();
        assert!(used.len() > 5 && used.is_subset(&known), "{used:?}");
    }
}
