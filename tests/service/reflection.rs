//! Reflection: a client that has no files of ours finds every service, in both versions of the protocol.

use crate::harness::*;
use tonic::Request;
use tonic::client::Grpc;
use tonic::codegen::http::uri::PathAndQuery;
use tonic_prost::ProstCodec;
use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
use tonic_reflection::pb::v1::{ServerReflectionRequest, ServerReflectionResponse};

/// The reply to one question; the messages of both versions are the same on the wire.
async fn asked(service: &Running, path: &'static str, question: MessageRequest) -> MessageResponse {
    let mut client = Grpc::new(service.channel.clone());
    client.ready().await.unwrap();
    let request = ServerReflectionRequest { host: String::new(), message_request: Some(question) };
    let codec = ProstCodec::<ServerReflectionRequest, ServerReflectionResponse>::default();
    let questions = Request::new(tokio_stream::iter([request]));
    let replies = client.streaming(questions, PathAndQuery::from_static(path), codec).await.unwrap();
    replies.into_inner().message().await.unwrap().unwrap().message_response.unwrap()
}

#[tokio::test]
async fn both_versions_of_reflection_list_the_services_and_describe_their_fields() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    for path in [
        "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
        "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
    ] {
        let MessageResponse::ListServicesResponse(list) =
            asked(&service, path, MessageRequest::ListServices(String::new())).await
        else {
            panic!("{path}: no list");
        };
        let names: Vec<String> = list.service.into_iter().map(|s| s.name).collect();
        for name in ["Models", "Operations", "Reasoning", "Statistics", "Traces", "Videos"] {
            assert!(names.contains(&format!("vrdp.v1.{name}")), "{path}: {name} is not in {names:?}");
        }
        let symbol = MessageRequest::FileContainingSymbol("vrdp.v1.Progress".into());
        let MessageResponse::FileDescriptorResponse(found) = asked(&service, path, symbol).await else {
            panic!("{path}: no file");
        };
        let files = found.file_descriptor_proto.iter();
        assert!(files.flatten().count() > 0, "{path}");
    }
    service.stop().await;
}
