//! Pictures as SVG: axes, scales, ticks. Colours are CSS classes: the page may be dark or light.

use crate::num::elementary;
use maud::{Markup, PreEscaped, Render, html};
use serde_json::{Value, json};

/// Colours and lines of pictures, light and dark.
pub const PICTURE_STYLE: &str = include_str!("picture.css");
/// Size of a chart, and the margins for its axes (px).
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 42.0;

/// A drawing: file name, title, caption, size (px), SVG elements, and the numbers that they show.
pub struct Picture {
    pub name: String,
    pub title: String,
    pub caption: String,
    pub size: [f64; 2],
    pub body: Markup,
    pub data: PictureData,
}

/// The numbers of a picture, for a look at single values and for a table; none of a picture that only illustrates.
#[derive(Default)]
pub struct PictureData {
    /// Names of the columns, with units.
    pub columns: Vec<String>,
    pub series: Vec<Series>,
}

/// A named list of points: the number of each column, and the place in the picture (px).
pub struct Series {
    pub name: String,
    pub points: Vec<(Vec<f64>, (f64, f64))>,
}

/// Most points of one picture that a page holds as numbers.
const MOST_POINTS: usize = 20_000;

impl PictureData {
    pub fn new(columns: &[&str], series: Vec<Series>) -> PictureData {
        PictureData { columns: columns.iter().map(|c| c.to_string()).collect(), series }
    }

    /// For the page's script; empty where there are no numbers, or too many.
    fn json(&self) -> Option<String> {
        let points = self.series.iter().map(|s| s.points.len()).sum::<usize>();
        let number = |v: f64| match v.is_finite() {
            true => format!("{v:.6e}").parse::<f64>().map_or(Value::Null, |v| json!(v)),
            false => Value::Null,
        };
        let tenth = |v: f64| number((10.0 * v).round() / 10.0);
        let one = |s: &Series| {
            let row = |(values, (x, y)): &(Vec<f64>, (f64, f64))| {
                values.iter().map(|v| number(*v)).chain([tenth(*x), tenth(*y)]).collect::<Vec<Value>>()
            };
            json!({ "name": s.name, "rows": s.points.iter().map(row).collect::<Vec<_>>() })
        };
        let text =
            || json!({ "columns": self.columns, "series": self.series.iter().map(one).collect::<Vec<_>>() });
        (1..=MOST_POINTS).contains(&points).then(|| embedded(&text().to_string()))
    }
}

/// JSON inside a script element: it is not markup, and only `<` could end it.
pub fn embedded(json: &str) -> String {
    json.replace('<', "\\u003c")
}

impl Picture {
    /// The figure for a page.
    pub fn figure(&self) -> Markup {
        html! {
            figure data-name=(self.name) {
                h3 { (self.title) }
                (self.svg(html! {}))
                @if let Some(data) = self.data.json() { script type="application/json" class="data" { (PreEscaped(data)) } }
                @if !self.caption.is_empty() { figcaption { (self.caption) } }
            }
        }
    }

    /// The SVG file, with a white background.
    pub fn file(&self) -> String {
        self.svg(
            html! { style { (PreEscaped(PICTURE_STYLE)) } rect class="paper" width="100%" height="100%" {} },
        )
        .into_string()
    }

    pub fn svg(&self, head: Markup) -> Markup {
        let [w, h] = self.size;
        html! {
            svg xmlns="http://www.w3.org/2000/svg" class="picture" viewBox={ "0 0 " (px(w)) " " (px(h)) } role="img"
                aria-label=(self.title) { title { (self.title) } (head) (self.body) }
        }
    }
}

/// A length or position in a drawing as text: never NaN, never infinite.
pub fn px(v: f64) -> impl Render {
    let v = if v.is_finite() { v.clamp(-1e5, 1e5) } else { 0.0 };
    let text = format!("{v:.1}");
    PreEscaped(text.strip_suffix(".0").map(str::to_string).unwrap_or(text))
}

/// The data of a path through the points; `None` interrupts it.
pub fn line(points: impl Iterator<Item = Option<(f64, f64)>>) -> String {
    let (mut out, mut connected) = (String::new(), false);
    for point in points {
        match point.filter(|(x, y)| x.is_finite() && y.is_finite()) {
            Some((x, y)) => {
                out += if connected { "L" } else { "M" };
                out += &format!("{} {}", px(x).render().into_string(), px(y).render().into_string());
                connected = true;
            }
            None => connected = false,
        }
    }
    out
}

/// The data of a path that draws each point as a dot.
pub fn dots(points: impl Iterator<Item = (f64, f64)>) -> String {
    let finite = points.filter(|(x, y)| x.is_finite() && y.is_finite());
    finite
        .map(|(x, y)| format!("M{} {}h0", px(x).render().into_string(), px(y).render().into_string()))
        .collect()
}

/// One axis: its range, its label, and whether it is logarithmic.
pub struct Axis {
    pub low: f64,
    pub high: f64,
    pub label: String,
    pub logarithmic: bool,
}

impl Axis {
    /// A range around the values; includes zero if `zero`.
    pub fn around(label: &str, values: impl Iterator<Item = f64>, zero: bool) -> Axis {
        let start = if zero { (0.0, 0.0) } else { (f64::INFINITY, f64::NEG_INFINITY) };
        let (low, high) = values.filter(|v| v.is_finite()).fold(start, |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let margin = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-3) };
        let keep = |edge: f64, moved: f64| if zero && edge == 0.0 { 0.0 } else { moved };
        let (low, high) = (keep(low, low - margin), keep(high, high + margin));
        Axis { low, high, label: label.into(), logarithmic: false }
    }

    /// A logarithmic range of whole powers of ten around the positive values.
    pub fn decades(label: &str, values: impl Iterator<Item = f64>) -> Axis {
        let start = (f64::INFINITY, 0.0f64);
        let good = values.filter(|v| v.is_finite() && *v > 0.0);
        let (low, high) = good.fold(start, |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low.max(1e-4 * high), high) } else { (1.0, 10.0) };
        let (low, high) = (
            elementary::powf(10f64, elementary::log10(low).floor()),
            elementary::powf(10f64, elementary::log10(high).ceil()),
        );
        Axis { low, high: if high > low { high } else { 10.0 * low }, label: label.into(), logarithmic: true }
    }

    fn share(&self, v: f64) -> f64 {
        if self.logarithmic {
            let (low, high) = (elementary::log10(self.low), elementary::log10(self.high));
            return (elementary::log10(v.max(self.low)) - low) / (high - low);
        }
        (v - self.low) / (self.high - self.low)
    }

    pub fn ticks(&self) -> Vec<f64> {
        if self.logarithmic {
            let (low, high) =
                (elementary::log10(self.low).round() as i32, elementary::log10(self.high).round() as i32);
            return (low..=high).map(|p| elementary::powi(10f64, p)).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let power = elementary::powf(10f64, elementary::log10(rough).floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        (first..first + 12).map(|k| k as f64 * step).take_while(|v| *v <= self.high + 1e-9 * step).collect()
    }
}

/// A number with three significant digits, without trailing zeros.
pub fn number(v: f64) -> String {
    if !v.is_finite() {
        return "–".into();
    }
    let size = v.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{v:.1e}").replace('-', "−");
    }
    let digits =
        if size == 0.0 { 0 } else { (2 - elementary::log10(size).floor() as i32).clamp(0, 5) as usize };
    let text = format!("{v:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.replace('-', "−") }
}

/// Two axes and the area between them.
pub struct Chart {
    pub x: Axis,
    pub y: Axis,
}

impl Chart {
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let inner = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
        (LEFT + inner.0 * self.x.share(x), TOP + inner.1 * (1.0 - self.y.share(y).clamp(-0.02, 1.02)))
    }

    /// The points of a curve of this chart as numbers.
    pub fn series(&self, name: &str, points: impl Iterator<Item = (f64, f64)>) -> Series {
        let points = points.map(|(x, y)| (vec![x, y], self.at(x, y))).collect();
        Series { name: name.into(), points }
    }

    /// The area of the data: left, top, right, bottom (px).
    pub fn inside() -> [f64; 4] {
        [LEFT, TOP, WIDTH - RIGHT, HEIGHT - BOTTOM]
    }

    /// The picture of the axes with `data` between them.
    pub fn picture(&self, name: &str, title: &str, caption: &str, data: Markup) -> Picture {
        let [left, top, right, bottom] = Self::inside();
        let body = html! {
            @for tick in self.y.ticks() {
                @let (_, y) = self.at(self.x.low, tick);
                line class="grid" x1=(px(left)) x2=(px(right)) y1=(px(y)) y2=(px(y)) {}
                text class="small" x=(px(left - 6.0)) y=(px(y + 4.0)) text-anchor="end" { (number(tick)) }
            }
            @for tick in self.x.ticks() {
                @let (x, _) = self.at(tick, self.y.low);
                line class="axis" x1=(px(x)) x2=(px(x)) y1=(px(bottom)) y2=(px(bottom + 4.0)) {}
                text class="small" x=(px(x)) y=(px(bottom + 17.0)) text-anchor="middle" { (number(tick)) }
            }
            line class="axis" x1=(px(left)) x2=(px(right)) y1=(px(bottom)) y2=(px(bottom)) {}
            (data)
            text x=(px(0.5 * (left + right))) y=(px(HEIGHT - 6.0)) text-anchor="middle" { (self.x.label) }
            text x=(px(-0.5 * (top + bottom))) y="12" text-anchor="middle" transform="rotate(-90)" { (self.y.label) }
        };
        let size = [WIDTH, HEIGHT];
        let data = PictureData::default();
        Picture { name: name.into(), title: title.into(), caption: caption.into(), size, body, data }
    }
}
