//! The metrics of the process for Prometheus: names, meanings and buckets.

use super::byte_budget::Budgets;
use super::process_metrics::process_metrics;
use crate::api::DESCRIPTORS;
use crate::engine::{Engine, metric_names};
use metrics::{Unit, describe_counter, describe_gauge, describe_histogram, gauge};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use prost::Message;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

pub const CALLS: &str = "vrdp_calls_total";
pub const REFUSED_CONNECTIONS: &str = "vrdp_connections_refused_total";
pub const REQUEST_BYTES: &str = "vrdp_request_bytes_in_flight";
pub const REPLY_BYTES: &str = "vrdp_reply_bytes_in_flight";
pub const READY: &str = "vrdp_ready";
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
    describe_counter!(
        REFUSED_CONNECTIONS,
        "Connections closed at once: all places of the port had running calls"
    );
    describe_gauge!(REQUEST_BYTES, "Bytes of requests that arrive or wait");
    describe_gauge!(REPLY_BYTES, "Bytes of replies that are not sent yet");
    describe_gauge!(READY, "1 if the service is ready for calls, else 0");
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
pub fn render(engine: &Engine, budgets: &Budgets) -> String {
    let Some(Some(recorder)) = RECORDER.get() else { return String::new() };
    let load = engine.load();
    gauge!(metric_names::WAITING).set(load.waiting as f64);
    gauge!(metric_names::RUNNING).set(load.running as f64);
    gauge!(metric_names::OLDEST_WAIT).set(load.oldest.as_secs_f64());
    if let Some(free) = engine.storage().free_bytes {
        gauge!(metric_names::FREE_BYTES).set(free as f64);
    }
    gauge!(REQUEST_BYTES).set((budgets.requests.used() + budgets.imports.used()) as f64);
    gauge!(REPLY_BYTES).set(budgets.replies.used() as f64);
    recorder.render() + &process_metrics()
}

/// Empties the buffers of the histograms; to be called every few seconds.
pub fn upkeep() {
    if let Some(Some(recorder)) = RECORDER.get() {
        recorder.run_upkeep();
    }
}

/// The methods of all services, by path (`/vrdp.v1.Videos/GetVideo`). Other paths never become a label.
pub struct Methods(BTreeMap<String, MethodShape>);

#[derive(Clone, Copy)]
struct MethodShape {
    streams_requests: bool,
    streams_replies: bool,
}

impl Methods {
    pub fn new() -> Methods {
        let mut found = BTreeMap::new();
        for bytes in [DESCRIPTORS, tonic_health::pb::FILE_DESCRIPTOR_SET] {
            let Ok(set) = prost_types::FileDescriptorSet::decode(bytes) else { continue };
            for file in set.file {
                for service in &file.service {
                    let one = |m: &prost_types::MethodDescriptorProto| {
                        let path = format!("/{}.{}/{}", file.package(), service.name(), m.name());
                        let (streams_requests, streams_replies) =
                            (m.client_streaming(), m.server_streaming());
                        (path, MethodShape { streams_requests, streams_replies })
                    };
                    found.extend(service.method.iter().map(one));
                }
            }
        }
        Methods(found)
    }

    /// The method of a path without its first slash, or `other`.
    pub fn name(&self, path: &str) -> &str {
        self.0.get_key_value(path).map_or("other", |(path, _)| path.trim_start_matches('/'))
    }

    /// Whether a call may send several messages; so may one of an unknown method.
    pub fn streams_requests(&self, path: &str) -> bool {
        self.0.get(path).is_none_or(|shape| shape.streams_requests)
    }

    /// Whether a call may get several messages; so may one of an unknown method.
    pub fn streams_replies(&self, path: &str) -> bool {
        self.0.get(path).is_none_or(|shape| shape.streams_replies)
    }

    /// The names of the services, such as `vrdp.v1.Videos`.
    pub fn services(&self) -> BTreeSet<&str> {
        self.0.keys().filter_map(|path| path.trim_start_matches('/').split('/').next()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::server::process_metrics::PROCESS_METRICS;

    fn names_in(text: &str) -> BTreeSet<&str> {
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        words
            .filter(|w| w.starts_with("vrdp_") || w.starts_with("process_"))
            .map(|w| w.trim_end_matches("_bucket"))
            .collect()
    }

    #[test]
    fn the_dashboard_and_the_alerts_use_metrics_that_exist() {
        let ours = [CALLS, CALL_SECONDS, REFUSED_CONNECTIONS, REQUEST_BYTES, REPLY_BYTES, READY];
        let names = ours.into_iter().chain(PROCESS_METRICS);
        let names = names.chain(metric_names::COUNTERS.map(|(name, _)| name));
        let names = names.chain(metric_names::HISTOGRAMS.map(|(name, _)| name));
        let known: BTreeSet<&str> = names.chain(metric_names::GAUGES.map(|(name, _)| name)).collect();
        for (file, least) in [
            (include_str!("../../../deploy/grafana/dashboards/vrdp.json"), 5),
            (include_str!("../../../deploy/alerts.yml"), 5),
        ] {
            let used = names_in(file);
            assert!(used.len() > least && used.is_subset(&known), "{used:?}");
        }
    }

    #[test]
    fn every_service_is_known_by_its_methods() {
        let methods = Methods::new();
        assert!(methods.services().contains("vrdp.v1.Videos"), "{:?}", methods.services());
        assert_eq!(methods.name("/vrdp.v1.Videos/GetVideo"), "vrdp.v1.Videos/GetVideo");
        assert_eq!(methods.name("/nothing"), "other");
        assert!(methods.streams_requests("/vrdp.v1.Reasoning/AskMany"));
        assert!(!methods.streams_requests("/vrdp.v1.Videos/CreateVideo"));
        assert!(!methods.streams_replies("/vrdp.v1.Videos/GetVideo"));
    }
}
