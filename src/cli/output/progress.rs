//! Progress on standard error: bars on a terminal, lines elsewhere, nothing with --quiet.

use super::write::tell;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::cell::Cell;
use std::future::Future;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Interval at which spinners and clocks are redrawn.
const TICK: Duration = Duration::from_millis(200);
/// Interval of the lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(3);
/// A reply that takes less shows no spinner.
const SPINNER_AFTER: Duration = Duration::from_secs(1);

static QUIET: AtomicBool = AtomicBool::new(false);

/// Switches all progress off.
pub fn silence() {
    QUIET.store(true, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// A bar of `length` steps; `template` is one of indicatif.
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

/// The progress of a task in one or several steps: a bar on a terminal, else a line every few seconds.
pub struct TaskProgress {
    bar: ProgressBar,
    start: Instant,
    last_line: Cell<Instant>,
}

impl TaskProgress {
    pub fn new(steps: usize) -> TaskProgress {
        let bar = bar(100 * steps as u64, "{msg:24} {bar:40} {percent:>3} %  {elapsed}");
        if !bar.is_hidden() {
            bar.enable_steady_tick(TICK);
        }
        let now = Instant::now();
        TaskProgress { bar, start: now, last_line: Cell::new(now) }
    }

    /// Shows that `done` steps are complete and the fraction of the current one, 0 to 1; `label` says what runs.
    pub fn show(&self, label: &str, done: usize, fraction: f64) {
        self.bar.set_message(label.to_string());
        self.bar.set_position(100 * done as u64 + (100.0 * fraction) as u64);
        if self.bar.is_hidden() && !is_quiet() && self.last_line.get().elapsed() >= LINE_EVERY {
            self.last_line.set(Instant::now());
            let seconds = self.start.elapsed().as_secs_f64();
            tell(&format!("{label}: {:.0} % after {seconds:.0} s", 100.0 * fraction));
        }
    }
}

impl Drop for TaskProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Waits for a reply without progress; shows a spinner labelled `what` if it takes long.
pub async fn during<T>(what: &'static str, reply: impl Future<Output = T>) -> T {
    let mut reply = std::pin::pin!(reply);
    if let Ok(reply) = tokio::time::timeout(SPINNER_AFTER, &mut reply).await {
        return reply;
    }
    let spinner = styled(ProgressBar::new_spinner(), "{spinner} {msg}  {elapsed}");
    spinner.set_message(what);
    spinner.enable_steady_tick(TICK);
    let reply = reply.await;
    spinner.finish_and_clear();
    reply
}
