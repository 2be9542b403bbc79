//! Spans reach a collector of OpenTelemetry and name a call by its id.

use crate::endure::Program;
use crate::harness::*;
use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::trace::v1::Span;
use std::time::Duration;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status};
use vrdp::api::v1;

/// Forwards each span that it receives.
struct Collector(mpsc::UnboundedSender<Span>);

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        let resources = request.into_inner().resource_spans;
        let spans = resources.into_iter().flat_map(|r| r.scope_spans).flat_map(|s| s.spans);
        spans.for_each(|span| self.0.send(span).unwrap());
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_collector_receives_the_spans_of_a_call() {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let (sender, mut spans) = mpsc::unbounded_channel();
    let collector =
        tonic::transport::Server::builder().add_service(TraceServiceServer::new(Collector(sender)));
    let incoming = tokio_stream::wrappers::TcpListenerStream::new(listener);
    tokio::spawn(collector.serve_with_incoming(incoming));

    let folder = tempfile::tempdir().unwrap();
    // Spans do not depend on the log filter.
    let program = Program::start_with(folder.path(), &[("VRDP_OTLP", &url), ("VRDP_LOG", "off")]);
    let mut videos = VideosClient::new(program.channel().await);
    let created = v1::CreateVideoRequest { video: Some(fixture("scene_00000")), ..Default::default() };
    let video = videos.create_video(created).await.unwrap().into_inner().name;
    let mut request = Request::new(v1::SimulateRequest { video, ..Default::default() });
    request.metadata_mut().insert("x-request-id", "the-one".parse().unwrap());
    ReasoningClient::new(program.channel().await).simulate(request).await.unwrap();

    let mut seen: Vec<Span> = vec![];
    let of = |seen: &[Span], name: &str, parent: &[u8]| -> Option<Vec<u8>> {
        let own = seen.iter().find(|s| s.name == name && s.parent_span_id == parent);
        own.map(|s| s.span_id.clone())
    };
    let trace_of_call = |seen: &[Span]| -> Option<Vec<u8>> {
        let id = |s: &&Span| {
            s.attributes.iter().any(|a| a.key == "request_id" && format!("{:?}", a.value).contains("the-one"))
        };
        let call = seen.iter().find(|s| s.name == "call" && id(s))?;
        let works = seen.iter().filter(|s| s.name == "work" && s.parent_span_id == call.span_id);
        works.filter_map(|w| of(seen, "job", &w.span_id).and(of(seen, "publish", &w.span_id))).next()
    };
    let all = async {
        while trace_of_call(&seen).is_none() {
            seen.push(spans.recv().await.unwrap());
        }
    };
    let ended = tokio::time::timeout(Duration::from_secs(60), all).await;
    assert!(ended.is_ok(), "no spans of the call, its job and its trace");
}
