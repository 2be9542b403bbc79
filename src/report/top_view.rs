//! The table seen from above: paths, bodies moved by a slider, and stroboscopic pictures.

use super::chart::{Axis, Picture, PictureData, dots, embedded, line, number, px};
use super::views::{FUTURE, PositionResidual, ReportViews};
use super::{AnsweredQuestion, ReportData};
use crate::num::elementary;
use crate::scene::{Object, Scene, Shape};
use crate::world::{BodySpec, EventKind, Trace, trace};
use maud::{Markup, html};
use serde_json::{Value, json};

/// Size of a view (px).
const WIDTH: f64 = 400.0;
const TALLEST: f64 = 420.0;
/// Margin around the measured positions (m), and how far beyond them a simulation is shown, as a share of their range.
const MARGIN: f64 = 0.3;
const BEYOND: f64 = 0.35;
/// Largest number of copies of a body in a stroboscopic picture.
const FLASHES: usize = 14;

/// The part of the plane that a picture shows; y points up.
pub struct PlanView {
    left: f64,
    top: f64,
    /// px per m.
    scale: f64,
    pub size: [f64; 2],
}

impl PlanView {
    /// Shows all measured positions of the scenes, and a part of the simulations beyond them.
    pub fn around<'a>(scenes: impl Iterator<Item = &'a Scene> + Clone, runs: &[&Trace]) -> PlanView {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        let mut take = |x: f64, y: f64| {
            for (k, v) in [x, y].into_iter().enumerate().filter(|(_, v)| v.is_finite()) {
                low[k] = low[k].min(v);
                high[k] = high[k].max(v);
            }
        };
        for scene in scenes {
            let samples = scene.tracks.iter().flat_map(|t| &t.samples);
            samples.for_each(|s| take(s.position.x, s.position.y));
            if let Some(table) = &scene.table {
                take(table.x[0], table.y[0]);
                take(table.x[1], table.y[1]);
            }
        }
        if !(low[0] <= high[0] && low[1] <= high[1]) {
            (low, high) = ([-1.0; 2], [1.0; 2]);
        }
        let reach = BEYOND * (high[0] - low[0]).max(high[1] - low[1]);
        let (least, most) = (low, high);
        for state in runs.iter().flat_map(|r| r.states.iter().flatten().flatten()) {
            for (k, v) in
                [state.position.x, state.position.y].into_iter().enumerate().filter(|(_, v)| v.is_finite())
            {
                low[k] = low[k].min(v.max(least[k] - reach));
                high[k] = high[k].max(v.min(most[k] + reach));
            }
        }
        let (wide, tall) = (high[0] - low[0] + 2.0 * MARGIN, high[1] - low[1] + 2.0 * MARGIN);
        let scale = (WIDTH / wide).min(TALLEST / tall);
        let spare = 0.5 * (WIDTH / scale - wide);
        PlanView { left: low[0] - MARGIN - spare, top: high[1] + MARGIN, scale, size: [WIDTH, tall * scale] }
    }

    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        ((x - self.left) * self.scale, (self.top - y) * self.scale)
    }

    fn measured(&self, scene: &Scene, object: usize) -> String {
        let samples = scene.tracks.get(object).into_iter().flat_map(|t| &t.samples);
        dots(samples.map(|s| self.at(s.position.x, s.position.y)))
    }

    fn path(&self, run: &Trace, body: usize, frames: std::ops::Range<usize>) -> String {
        let rows = run.states.get(frames.start.min(run.states.len())..frames.end.min(run.states.len()));
        let place = |row: &Vec<Option<crate::world::State>>| {
            let p = row.get(body).copied().flatten()?.position;
            Some(self.at(p.x, p.y))
        };
        line(rows.unwrap_or_default().iter().map(place))
    }

    /// x, y (px) and rotation (degrees, clockwise) in each frame; `null` where a body is absent.
    fn poses(&self, run: &Trace, body: usize) -> Value {
        let pose = |row: &Vec<Option<crate::world::State>>| match row.get(body).copied().flatten() {
            Some(s) => self.pose(s.position.x, s.position.y, s.yaw),
            None => Value::Null,
        };
        run.states.iter().map(pose).collect()
    }

    fn pose(&self, x: f64, y: f64, yaw: f64) -> Value {
        let (x, y) = self.at(x, y);
        let tenth = |v: f64| if v.is_finite() { (10.0 * v).round() / 10.0 } else { 0.0 };
        json!([tenth(x), tenth(y), tenth(-yaw.to_degrees() % 360.0)])
    }

    fn measured_poses(&self, scene: &Scene, object: usize, frames: usize) -> Value {
        let mut all = vec![Value::Null; frames];
        for s in scene.tracks.get(object).into_iter().flat_map(|t| &t.samples) {
            if let Some(slot) = all.get_mut(s.frame) {
                *slot = self.pose(s.position.x, s.position.y, s.yaw.unwrap_or(0.0));
            }
        }
        all.into()
    }

    fn outline(&self, shape: &Shape) -> Markup {
        let r = |v: f64| px((v * self.scale).max(2.0));
        let mark = |v: f64| px(0.9 * (v * self.scale).max(2.0));
        let rect = |l: f64, w: f64| {
            html! {
                rect x=(px(-l * self.scale)) y=(px(-w * self.scale)) width=(r(2.0 * l)) height=(r(2.0 * w)) {}
            }
        };
        match *shape {
            Shape::Ball { radius } => {
                html! { circle r=(r(radius)) {} circle class="mark" r=(px(0.25 * radius * self.scale)) {} }
            }
            Shape::Disc { radius } => html! { circle r=(r(radius)) {} line x2=(mark(radius)) {} },
            Shape::Square { half_side } => {
                html! { (rect(half_side, half_side)) line x2=(mark(half_side)) {} }
            }
            Shape::Rectangle { half_length, half_width } => {
                html! { (rect(half_length, half_width)) line x2=(mark(half_length)) {} }
            }
        }
    }

    /// A line from the simulated to the measured position, with its length.
    fn residual(&self, r: &PositionResidual) -> Markup {
        let (x, y) = self.at(r.at[0], r.at[1]);
        let (to_x, to_y) = self.at(r.at[0] - r.off[0], r.at[1] - r.off[1]);
        let left = x.max(to_x) > 0.6 * self.size[0];
        let place = if left { x.min(to_x) - 8.0 } else { x.max(to_x) + 8.0 };
        html! {
            path class="off" d=(line([Some((x, y)), Some((to_x, to_y))].into_iter())) {}
            text class="off" x=(px(place)) y=(px((0.5 * (y + to_y) - 14.0).max(14.0))) text-anchor=[left.then_some("end")] {
                (number(1e3 * r.size())) " mm"
            }
        }
    }

    fn ground(&self, scene: &Scene) -> Markup {
        html! {
            @if let Some(t) = &scene.table {
                @let (x, y) = self.at(t.x[0], t.y[1]);
                rect class="wall" x=(px(x)) y=(px(y)) width=(px((t.x[1] - t.x[0]) * self.scale))
                    height=(px((t.y[1] - t.y[0]) * self.scale)) {}
            }
            (self.axes())
        }
    }

    /// The frame with ticks and their values (m): x below, y at the left.
    pub fn axes(&self) -> Markup {
        let [w, h] = self.size;
        let axis = |low: f64, reach: f64| Axis {
            low,
            high: low + reach / self.scale,
            label: String::new(),
            logarithmic: false,
        };
        let (x_axis, y_axis) = (axis(self.left, w), axis(self.top - h / self.scale, h));
        html! {
            @for tick in x_axis.ticks() {
                @let (x, _) = self.at(tick, 0.0);
                @if (24.0..w - 44.0).contains(&x) {
                    line class="axis" x1=(px(x)) x2=(px(x)) y1=(px(h)) y2=(px(h - 5.0)) {}
                    text class="small" x=(px(x)) y=(px(h - 8.0)) text-anchor="middle" { (number(tick)) }
                }
            }
            @for tick in y_axis.ticks() {
                @let (_, y) = self.at(0.0, tick);
                @if (20.0..h - 20.0).contains(&y) {
                    line class="axis" x1="0" x2="5" y1=(px(y)) y2=(px(y)) {}
                    text class="small" x="8" y=(px(y + 4.0)) { (number(tick)) }
                }
            }
            text class="small" x=(px(w - 6.0)) y=(px(h - 8.0)) text-anchor="end" { "x (m)" }
            text class="small" x="8" y="14" { "y (m)" }
            rect class="axis" x="0.5" y="0.5" width=(px(w - 1.0)) height=(px(h - 1.0)) {}
        }
    }

    /// One side of a player; adds the poses of its bodies, one list for each `data-track`, to `tracks`.
    fn side(
        &self,
        scene: &Scene,
        side: &PlayerSide,
        frames: usize,
        farthest: Option<&PositionResidual>,
        tracks: &mut Vec<Value>,
    ) -> Markup {
        let observed = scene.times.len();
        let (mut ghosts, mut bodies) = (vec![], vec![]);
        if side.measured {
            for (k, object) in scene.objects.iter().enumerate() {
                ghosts.push((tracks.len(), object));
                tracks.push(self.measured_poses(scene, k, frames));
            }
        }
        for (k, id) in side.run.ids.iter().enumerate() {
            if let Some(object) = scene.objects.iter().find(|o| o.id == *id) {
                bodies.push((tracks.len(), k, object));
                tracks.push(self.poses(side.run, k));
            }
        }
        html! {
            (self.ground(scene))
            @if side.measured {
                @for k in 0..scene.objects.len() { path class="dots thin measured" d=(self.measured(scene, k)) {} }
            }
            @for (_, k, object) in &bodies {
                @let fill = colour(&object.color, scene.object_index(object.id).unwrap_or(0));
                @let stroke = if side.class.is_empty() { fill } else { "" };
                path class={ "path " (side.class) } stroke=[(!stroke.is_empty()).then_some(stroke)]
                    d=(self.path(side.run, *k, 0..observed)) {}
                path class={ "path future " (side.class) } stroke=[(!stroke.is_empty()).then_some(stroke)]
                    d=(self.path(side.run, *k, observed.saturating_sub(1)..frames)) {}
            }
            @for (t, _, object) in &bodies {
                @let fill = colour(&object.color, scene.object_index(object.id).unwrap_or(0));
                g class="body" data-track=(t) fill=(fill) { (self.outline(&object.shape)) }
            }
            @for (t, object) in &ghosts { g class="ghost" data-track=(t) { (self.outline(&object.shape)) } }
            @if let Some(r) = farthest { (self.residual(r)) }
        }
    }
}

/// The colour of an object by its colour name; unknown names get one by index.
pub fn colour(name: &str, index: usize) -> &'static str {
    const OTHERS: [&str; 6] = ["#3f7fd6", "#d64545", "#3a9d5d", "#c98a00", "#8e5bd0", "#1fa7b8"];
    match name {
        "red" => "#d64545",
        "green" => "#3a9d5d",
        "blue" => "#3f7fd6",
        "gray" | "grey" => "#8a8f98",
        "brown" => "#a0703c",
        "cyan" => "#1fa7b8",
        "purple" => "#8e5bd0",
        "yellow" => "#c9a400",
        _ => OTHERS[index % OTHERS.len()],
    }
}

/// The name of an object: color, material, shape and id.
pub fn name(object: &Object) -> String {
    let words = [object.color.as_str(), object.material.as_str(), object.shape.word()];
    let words: Vec<&str> = words.into_iter().filter(|w| !w.is_empty()).collect();
    format!("{} ({})", words.join(" "), object.id)
}

/// One of the simulations that a player shows side by side.
pub struct PlayerSide<'a> {
    pub title: String,
    pub run: &'a Trace,
    /// CSS class of its paths, `before` or `after`; empty: the colours of the objects.
    pub class: &'static str,
    /// Whether the measured positions are shown too.
    pub measured: bool,
}

/// Simulations side by side with one slider, which starts at the largest residual of the first. `extra` holds charts whose
/// cursor moves with it.
pub fn player(
    id: &str,
    scene: &Scene,
    sides: &[PlayerSide],
    farthest: Option<&PositionResidual>,
    extra: Markup,
) -> Markup {
    let runs: Vec<&Trace> = sides.iter().map(|s| s.run).collect();
    let view = PlanView::around(std::iter::once(scene), &runs);
    let frames = runs.iter().map(|r| r.states.len()).max().unwrap_or(1);
    let observed = scene.times.len();
    let mut tracks: Vec<Value> = vec![];
    let mut drawn = vec![];
    for (n, side) in sides.iter().enumerate() {
        let body = view.side(scene, side, frames, farthest.filter(|_| n == 0), &mut tracks);
        let title = side.title.clone();
        let (name, caption, data) = (format!("{id}-{}", n + 1), String::new(), PictureData::default());
        drawn.push(Picture { name, title, caption, size: view.size, body, data });
    }
    let times: Vec<f64> = (0..frames).map(|f| (1e3 * scene.time_of(f)).round() / 1e3).collect();
    let start = farthest.map_or(observed.min(frames).saturating_sub(1), |r| r.frame);
    let data = json!({ "times": times, "observed": observed, "start": start, "tracks": tracks }).to_string();
    html! {
        div class="player" id=(id) {
            div class="controls" {
                button type="button" class="play" aria-pressed="false" { "▶ Play" }
                input type="range" class="time" min="0" max=(frames.saturating_sub(1)) value="0" step="1"
                    aria-label={ "Time in " (scene.name) };
                output class="clock" { "0.00 s" }
                @if farthest.is_some() { button type="button" class="worst" { "Largest residual" } }
            }
            div class="sides" { @for picture in &drawn { (picture.figure()) } }
            (extra)
            script type="application/json" class="motion" { (maud::PreEscaped(embedded(&data))) }
        }
    }
}

/// The bodies at equal time steps, fainter the earlier; dashed after the video.
pub fn strobe(name: &str, title: &str, scene: &Scene, run: &Trace, added: &[&BodySpec]) -> Picture {
    let view = PlanView::around(std::iter::once(scene), &[run]);
    let frames = run.states.len();
    let step = frames.div_ceil(FLASHES).max(1);
    let observed = scene.times.len();
    let shape = |id: &u32| {
        let seen = scene.objects.iter().find(|o| o.id == *id).map(|o| (o.color.clone(), o.shape));
        seen.or_else(|| added.iter().find(|b| b.id == *id).map(|b| (String::new(), b.shape)))
    };
    let bodies: Vec<(usize, String, Shape)> =
        run.ids.iter().enumerate().filter_map(|(k, id)| shape(id).map(|(c, s)| (k, c, s))).collect();
    let flashes: Vec<usize> = (0..frames).rev().step_by(step).collect::<Vec<_>>().into_iter().rev().collect();
    let hits = run.events.iter().filter(|e| e.kind == EventKind::Collision);
    let body = html! {
        (view.ground(scene))
        @for (k, name, shape) in &bodies {
            @let fill = colour(name, *k);
            path class="path" stroke=(fill) d=(view.path(run, *k, 0..observed)) {}
            path class="path future" stroke=(fill) d=(view.path(run, *k, observed.saturating_sub(1)..frames)) {}
            @for (n, f) in flashes.iter().enumerate() {
                @if let Some(s) = run.states.get(*f).and_then(|row| row.get(*k).copied().flatten()) {
                    @let (x, y) = view.at(s.position.x, s.position.y);
                    @let opacity = 0.12 + 0.88 * elementary::powi((n + 1) as f64 / flashes.len() as f64, 2);
                    g class="strobe" fill=(fill) opacity=(format!("{opacity:.2}"))
                        stroke-dasharray=[(*f >= observed).then_some("3 2")]
                        transform={ "translate(" (px(x)) " " (px(y)) ") rotate(" (px(-s.yaw.to_degrees() % 360.0)) ")" } {
                        (view.outline(shape))
                    }
                }
            }
        }
        @for hit in hits {
            @let (x, y) = view.at(hit.position.x, hit.position.y);
            path class="cursor" d={ "M" (px(x - 4.0)) " " (px(y)) "h8M" (px(x)) " " (px(y - 4.0)) "v8" } {}
        }
    };
    let caption = format!(
        "The bodies every {} s, later ones darker; dashed after the video; + marks contacts.",
        number(step as f64 / scene.fps)
    );
    let (name, title, data) = (name.into(), title.into(), PictureData::default());
    Picture { name, title, caption, size: view.size, body, data }
}

/// The predictions of the last model, and the simulations of each answer without and with the change.
pub fn strobes(report: &ReportData, views: &ReportViews) -> Vec<Picture> {
    let mut all = vec![];
    if let Some(last) = views.stages.last() {
        for (k, (scene, run)) in report.scenes.iter().zip(&last.runs).enumerate() {
            let title = format!("{}: predicted, {FUTURE} frames beyond the video", scene.name);
            all.push(strobe(&format!("prediction-{}", k + 1), &title, scene, run, &[]));
        }
    }
    for (k, answered) in report.answers.iter().enumerate() {
        all.extend(of_answer(k, answered));
    }
    all
}

/// The simulation of an answer's model without changes, as long as its other simulations.
pub fn factual(answered: &AnsweredQuestion) -> Trace {
    let frames = answered.answer.simulations.iter().map(|s| s.best.states.len()).max().unwrap_or(0);
    let times: Vec<f64> = (0..frames).map(|f| answered.scene.time_of(f)).collect();
    trace(answered.model, &times).as_observed(answered.model)
}

/// The simulations of an answer without and with the change.
pub fn of_answer(number: usize, answered: &AnsweredQuestion) -> Vec<Picture> {
    let AnsweredQuestion { scene, model, answer, .. } = *answered;
    let name = |kind: &str| format!("answer-{}-{kind}", number + 1);
    let mut all = vec![];
    if !answer.simulations.is_empty() {
        let title = format!("{}: without a change", scene.name);
        let bodies: Vec<&BodySpec> = model.bodies.iter().collect();
        all.push(strobe(&name("factual"), &title, scene, &factual(answered), &bodies));
    }
    for (n, s) in answer.simulations.iter().filter(|s| !s.interventions.is_empty()).enumerate() {
        let bodies: Vec<&BodySpec> = s.model.bodies.iter().collect();
        let title = format!("{}: with the change", scene.name);
        all.push(strobe(&name(&format!("counterfactual-{}", n + 1)), &title, scene, &s.best, &bodies));
    }
    all
}
