//! The service `Statistics`.

use super::{RpcResult, Services};
use crate::api::convert::names::video_name;
use crate::api::v1;
use crate::engine::{Engine, Job};
use std::time::Duration;
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::statistics_server::Statistics for Services {
    async fn get_statistics(
        &self,
        request: Request<v1::GetStatisticsRequest>,
    ) -> RpcResult<v1::ServiceStatistics> {
        Ok(Response::new(statistics(&self.owner(&request))))
    }
}

/// The load of the engine; its jobs are those of its tenant.
fn statistics(engine: &Engine) -> v1::ServiceStatistics {
    let (load, capacity) = (engine.load(), engine.capacity());
    let job = |job: Job| v1::RunningJob {
        kind: job.kind.into(),
        video: video_name(&job.video),
        progress: job.progress,
        age: duration(job.age),
    };
    v1::ServiceStatistics {
        version: env!("CARGO_PKG_VERSION").into(),
        uptime: duration(engine.uptime()),
        workers: capacity.workers as u32,
        queue_capacity: capacity.queue as u32,
        jobs_running: load.running as u32,
        jobs_waiting: load.waiting as u32,
        oldest_wait: duration(load.oldest),
        fits: engine.fits_run(),
        jobs: engine.jobs().into_iter().map(job).collect(),
    }
}

fn duration(time: Duration) -> Option<prost_types::Duration> {
    prost_types::Duration::try_from(time).ok()
}
