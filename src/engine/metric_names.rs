//! Names and meanings of the engine's metrics. No metric has a label by video, model or caller.

use crate::store::WRITE_ERRORS;

pub const WAITING: &str = "vrdp_jobs_waiting";
pub const RUNNING: &str = "vrdp_jobs_running";
pub const OLDEST_WAIT: &str = "vrdp_jobs_oldest_wait_seconds";
pub const WAIT_SECONDS: &str = "vrdp_job_wait_seconds";
pub const JOB_SECONDS: &str = "vrdp_job_seconds";
pub const REFUSED: &str = "vrdp_jobs_refused_total";
pub const PANICKED: &str = "vrdp_jobs_panicked_total";
pub const FITS: &str = "vrdp_fits_total";
pub const RESULTS: &str = "vrdp_results_total";
pub const TRACES: &str = "vrdp_traces_total";
pub const TRACE_BYTES: &str = "vrdp_trace_bytes_total";
pub const ORPHANS: &str = "vrdp_orphans_removed_total";
pub const FREE_BYTES: &str = "vrdp_storage_free_bytes";

pub const GAUGES: [(&str, &str); 4] = [
    (WAITING, "Jobs that wait for a CPU thread"),
    (RUNNING, "Jobs on CPU threads"),
    (OLDEST_WAIT, "Waiting time of the oldest queued job"),
    (FREE_BYTES, "Bytes that may still be written to the disk of the data folder"),
];
pub const HISTOGRAMS: [(&str, &str); 2] =
    [(WAIT_SECONDS, "Time that jobs waited for a CPU thread"), (JOB_SECONDS, "Time that jobs ran")];
pub const COUNTERS: [(&str, &str); 8] = [
    (REFUSED, "Jobs refused because the queue was full"),
    (PANICKED, "Jobs that panicked"),
    (FITS, "Fits that were computed, not read from the store"),
    (
        RESULTS,
        "Requested results by kind and source: memory, flight (shared with another caller's job), store, made",
    ),
    (TRACES, "Trace files that were stored"),
    (TRACE_BYTES, "Bytes of trace files that were stored"),
    (ORPHANS, "Trace files without a record that were removed"),
    (WRITE_ERRORS, "Writes to the disk of the data folder that failed"),
];

/// Counts one result of that kind by its source.
pub fn count_result(kind: &'static str, source: &'static str) {
    metrics::counter!(RESULTS, "kind" => kind, "source" => source).increment(1);
}
