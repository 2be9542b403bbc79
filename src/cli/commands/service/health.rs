//! `health`: asks whether a service is running, for the health check of a container.

use crate::cli::connection::Target;
use crate::cli::connection::remote;
use crate::cli::error::Failure;
use crate::cli::output::print;
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
        status => Err(Failure::other(format!("the service at {url} is not ready: {}", status.as_str_name()))),
    }
}
