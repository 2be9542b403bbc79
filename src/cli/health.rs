//! `health`: asks a service whether it serves, for a container's health check.

use super::Target;
use super::error::Failure;
use super::output::print;
use super::wire::remote;
use crate::config::local_service_url;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};

pub async fn run(target: &Target) -> Result<(), Failure> {
    let url = match &target.server {
        Some(url) => url.clone(),
        None => local_service_url().map_err(|e| Failure::input(e.to_string()))?,
    };
    let channel = remote(&url, target).await?;
    let request = HealthCheckRequest { service: String::new() };
    let reply = HealthClient::new(channel).check(request).await.map_err(|s| Failure::other(s.message()))?;
    match reply.into_inner().status() {
        ServingStatus::Serving => print("serving\n"),
        status => Err(Failure::other(format!("{url} says {}", status.as_str_name()))),
    }
}
