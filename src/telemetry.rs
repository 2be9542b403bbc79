//! Logs to standard error, as text or as JSON; spans to a collector, if the settings name one.

use std::io::IsTerminal;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt};

/// Sends the remaining spans when it is dropped.
#[must_use]
#[derive(Default)]
pub struct Telemetry {
    #[cfg(feature = "otlp")]
    spans: Option<opentelemetry_sdk::trace::SdkTracerProvider>,
}

/// Starts logging; a second call changes nothing. Refuses an invalid filter, and a collector (URL of its OTLP port over
/// gRPC) if this build has no feature `otlp`. To be called inside the runtime.
pub fn init(filter: &str, json: bool, collector: Option<&str>) -> Result<Telemetry, String> {
    let filter: Targets = filter
        .parse()
        .map_err(|e| format!("log {filter:?}: {e}; give a filter such as info or vrdp=debug"))?;
    let text = fmt::layer().with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr);
    let logs = if json { text.json().boxed() } else { text.boxed() };
    let (spans, telemetry) = match collector {
        Some(url) => spans(url)?,
        None => (None, Telemetry::default()),
    };
    // It fails only if a logger is already set, as in tests.
    let _ = tracing_subscriber::registry().with(spans).with(logs.with_filter(filter)).try_init();
    Ok(telemetry)
}

type Spans = Option<Box<dyn Layer<tracing_subscriber::Registry> + Send + Sync>>;

#[cfg(not(feature = "otlp"))]
fn spans(_collector: &str) -> Result<(Spans, Telemetry), String> {
    Err("otlp: this program was built without the feature; build it with `--features otlp`".into())
}

#[cfg(feature = "otlp")]
fn spans(collector: &str) -> Result<(Spans, Telemetry), String> {
    use opentelemetry::trace::TracerProvider;
    use opentelemetry_otlp::{SpanExporter, WithExportConfig};
    use opentelemetry_sdk::{Resource, trace::SdkTracerProvider};
    let exporter = SpanExporter::builder().with_tonic().with_endpoint(collector).build();
    let exporter = exporter.map_err(|e| format!("otlp {collector:?}: {e}; give the URL of a collector"))?;
    let resource = Resource::builder().with_service_name("vrdp").build();
    let provider = SdkTracerProvider::builder().with_resource(resource).with_batch_exporter(exporter).build();
    let layer = tracing_opentelemetry::layer().with_tracer(provider.tracer("vrdp"));
    // Our own spans only, whatever is logged: spans of the exporter's calls would cause further calls.
    let ours = Targets::new().with_target("vrdp", tracing::Level::INFO);
    Ok((Some(layer.with_filter(ours).boxed()), Telemetry { spans: Some(provider) }))
}

#[cfg(feature = "otlp")]
impl Drop for Telemetry {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.spans.take().map(|spans| spans.shutdown()) {
            eprintln!("the last spans could not be sent: {error}");
        }
    }
}
