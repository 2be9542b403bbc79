//! The dashboard of the service: jobs, videos with their models and reports, and the latest traces.

use super::chart::number;
use super::document::document;
use maud::{Markup, html};

const DASHBOARD_STYLE: &str = include_str!("dashboard.css");
const DASHBOARD_SCRIPT: &str = include_str!("dashboard.js");
/// Digits of an id that the page shows.
const DIGITS: usize = 8;

/// The content of the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Dashboard {
    pub version: &'static str,
    /// Jobs that run on the CPU pool, and jobs in its queue.
    pub running: usize,
    pub waiting: usize,
    /// Number of fits computed since the service started.
    pub fits: u64,
    pub jobs: Vec<JobRow>,
    /// By id.
    pub videos: Vec<VideoRow>,
    /// Id of the last of these videos if there are more.
    pub next: Option<String>,
    /// The latest traces, newest first.
    pub traces: Vec<TraceRow>,
    pub traces_in_all: usize,
    pub trace_bytes: u64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct JobRow {
    pub kind: &'static str,
    pub video: String,
    /// 0 to 1.
    pub progress: f64,
    /// Time since the start (s).
    pub seconds: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct VideoRow {
    pub id: String,
    pub name: String,
    pub frames: usize,
    pub objects: usize,
    pub seconds: f64,
    pub models: usize,
    /// Residual of the latest revision and measurement noise, root mean square (m).
    pub error: Option<(f64, f64)>,
    /// The kind of effect that the latest revision added.
    pub added: Option<String>,
    /// The videos of each stored discovery, this one first.
    pub discoveries: Vec<Vec<String>>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct TraceRow {
    pub id: String,
    pub video: String,
    pub about: String,
    pub size_bytes: u64,
}

/// The page; its script reloads it from the same origin. `tenant` is whose data it shows, where callers need a token.
pub fn dashboard(shown: &Dashboard, tenant: Option<&str>) -> String {
    let main = html! {
        header {
            p class="kind" { "vrdp " (shown.version) " · " span id="fresh" role="status" {}
                @if let Some(tenant) = tenant { " · tenant " a href="/login" { (tenant) } }
            }
            h1 { "Overview of the service" }
        }
        div id="live" { (tiles(shown)) (jobs(shown)) (videos(shown)) (traces(shown)) }
    };
    document("vrdp", "; connect-src 'self'", DASHBOARD_STYLE, main, DASHBOARD_SCRIPT)
}

fn tiles(shown: &Dashboard) -> Markup {
    let tile =
        |title: &str, value: String| html! { div class="tile" { span { (title) } strong { (value) } } };
    html! {
        div class="tiles" {
            (tile("running jobs", shown.running.to_string()))
            (tile("waiting jobs", shown.waiting.to_string()))
            (tile("fits since the start", shown.fits.to_string()))
            (tile("traces", format!("{} · {}", shown.traces_in_all, size(shown.trace_bytes))))
        }
    }
}

fn jobs(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Jobs" }
        @if shown.jobs.is_empty() { p class="quiet" { "No job is running." } }
        @else { div class="scroll" { table {
            thead { tr { th { "job" } th { "video" } th { "progress" } th { "time" } } }
            tbody { @for job in &shown.jobs { tr {
                th { (job.kind) }
                td { (name_of(shown, &job.video)) }
                td { progress max="1" value=(format!("{:.3}", job.progress)) aria-label=(job.kind) {} " " (percent(job.progress)) }
                td { (format!("{:.0} s", job.seconds)) }
            } } }
        } } }
    }
}

fn videos(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Videos" }
        @if shown.videos.is_empty() {
            p class="quiet" { "No videos yet. Post one with CreateVideo, or run: " code { "vrdp fit SCENE --server http://HOST:PORT" } }
        } @else { div class="scroll" { table {
            thead { tr { th { "video" } th { "length" } th { "objects" } th { "models" } th { "error" } th { "noise" } th { "added" } th { "report" } } }
            tbody { @for video in &shown.videos { tr {
                th { (video.name) " " span class="quiet" { (short(&video.id)) } }
                td { (format!("{:.1} s · {} frames", video.seconds, video.frames)) }
                td { (video.objects) }
                td { (video.models) }
                td { (mm(video.error.map(|e| e.0))) }
                td { (mm(video.error.map(|e| e.1))) }
                td { (video.added.as_deref().unwrap_or("")) }
                td { (reports(video)) }
            } } }
        } } }
        @if let Some(last) = &shown.next { p { a href={ "/?after=" (last) } { "more videos" } } }
    }
}

/// Links to the reports of stored discoveries, and one that starts a discovery on this video only.
fn reports(video: &VideoRow) -> Markup {
    let has_own = video.discoveries.iter().any(|videos| videos.len() == 1);
    let home = format!("/videos/{}/report", video.id);
    html! {
        @for videos in &video.discoveries {
            @match videos.get(1..) {
                Some(others) if !others.is_empty() => a href={ (home) "?with=" (others.join(",")) } { "of " (videos.len()) " videos" },
                _ => a href=(home) { "open" },
            }
            " "
        }
        @if !has_own { a href=(home) { "create" } }
    }
}

fn traces(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Latest traces" }
        @if shown.traces.is_empty() { p class="quiet" { "No traces yet. Every fit, simulation and answer writes one." } }
        @else { div class="scroll" { table {
            thead { tr { th { "trace" } th { "video" } th { "content" } th { "size" } } }
            tbody { @for trace in &shown.traces { tr {
                th { a href={ "/traces/" (trace.id) ".mcap" } { (short(&trace.id)) ".mcap" } }
                td { (name_of(shown, &trace.video)) }
                td { (trace.about) }
                td { (size(trace.size_bytes)) }
            } } }
        } } }
    }
}

fn name_of<'d>(shown: &'d Dashboard, id: &'d str) -> &'d str {
    shown.videos.iter().find(|v| v.id == id).map_or(short(id), |v| &v.name)
}

/// The first digits of an id, which is ASCII.
fn short(id: &str) -> &str {
    id.get(..DIGITS).unwrap_or(id)
}

fn mm(error: Option<f64>) -> String {
    error.map(|e| format!("{} mm", number(1e3 * e))).unwrap_or_default()
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.1} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.0} kB", b / 1e3),
    }
}
