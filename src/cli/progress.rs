//! Progress on standard error: bars and spinners where it is a terminal, and none at all with --quiet.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::future::Future;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often what moves on its own is drawn anew.
const TICK: Duration = Duration::from_millis(200);
/// What is done sooner needs no sign of life.
const PATIENCE: Duration = Duration::from_secs(1);

static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on nothing is shown.
pub fn silence() {
    QUIET.store(true, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// A bar of `length` steps, drawn as the template of indicatif says.
pub fn bar(length: u64, template: &str) -> ProgressBar {
    styled(ProgressBar::new(length), template)
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    if is_quiet() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// A bar of 100 steps that says what the service does.
pub fn percent(what: &'static str) -> ProgressBar {
    let bar = bar(100, "{msg:10} {bar:40} {percent:>3} %  {elapsed}");
    bar.set_message(what);
    bar.enable_steady_tick(TICK);
    bar
}

/// Waits for a reply that tells no progress; says what the service does where it takes long.
pub async fn during<T>(what: &'static str, reply: impl Future<Output = T>) -> T {
    let mut reply = std::pin::pin!(reply);
    if let Ok(reply) = tokio::time::timeout(PATIENCE, &mut reply).await {
        return reply;
    }
    let spinner = styled(ProgressBar::new_spinner(), "{spinner} {msg}  {elapsed}");
    spinner.set_message(what);
    spinner.enable_steady_tick(TICK);
    let reply = reply.await;
    spinner.finish_and_clear();
    reply
}
