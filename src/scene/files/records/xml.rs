//! Tracks in XML: TrackMate's tracks and models, the particle-tracking challenge, and CVAT's boxes.

use super::record_table::Field;
use super::{RecordTable, TableText};
use crate::scene::violations::SceneError;
use roxmltree::{Document, Node, ParsingOptions};
use std::collections::BTreeMap;

/// Names of an outline's four edges in CVAT.
const EDGES: [(&str, &str); 4] =
    [("xtl", "xmin [px]"), ("ytl", "ymin [px]"), ("xbr", "xmax [px]"), ("ybr", "ymax [px]")];

/// The table of XML with tracks; `None`: it has none, or is no XML.
pub(super) fn table(text: &str) -> Option<Result<TableText, SceneError>> {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).ok()?;
    let (table, what) = of_particles(&document)
        .map(|table| (table, "TrackMate's tracks"))
        .or_else(|| Some((of_boxes(&document)?, "CVAT's tracks")))
        .or_else(|| Some((of_model(&document)?, "TrackMate's spots, linked by its edges; where a track splits, the new part is another object")))?;
    Some(Ok(table.written(vec![what.to_string()])))
}

fn field(name: &str, value: impl Into<String>) -> Field {
    (name.to_string(), value.into())
}

fn attribute<'a>(node: &Node<'a, '_>, name: &str) -> &'a str {
    node.attribute(name).unwrap_or_default()
}

/// The unit behind the name of a length.
fn unit(word: Option<&str>) -> &'static str {
    match word.map(str::to_lowercase).as_deref() {
        Some("micron" | "microns" | "um" | "µm") => " [um]",
        Some("mm") => " [mm]",
        Some("cm") => " [cm]",
        Some("m") => " [m]",
        _ => " [px]",
    }
}

/// `<particle><detection t x y z/></particle>`; the interval gives the time of a frame.
fn of_particles(document: &Document) -> Option<RecordTable> {
    let root = document.root_element();
    let particles = document.descendants().filter(|node| node.has_tag_name("particle"));
    let mut table = RecordTable::default();
    let unit = unit(root.attribute("spaceUnits"));
    for (id, particle) in particles.enumerate() {
        for spot in particle.children().filter(|node| node.has_tag_name("detection")) {
            table.push([
                field("id", id.to_string()),
                field("frame", attribute(&spot, "t")),
                field(&format!("x{unit}"), attribute(&spot, "x")),
                field(&format!("y{unit}"), attribute(&spot, "y")),
            ]);
        }
    }
    let interval = root.attribute("frameInterval").and_then(|value| value.parse::<f64>().ok());
    let is_seconds = matches!(root.attribute("timeUnits"), Some("sec" | "s" | "seconds"));
    let rate = interval.filter(|interval| is_seconds && *interval > 0.0).map(|interval| 1.0 / interval);
    table.notes.extend(rate.map(|rate| format!("# fps: {rate}")));
    (table.len() > 0).then_some(table)
}

/// `<track id label><box frame xtl ytl xbr ybr outside/></track>`.
fn of_boxes(document: &Document) -> Option<RecordTable> {
    let mut table = RecordTable::default();
    for track in document.descendants().filter(|node| node.has_tag_name("track")) {
        for outline in track.children().filter(|node| node.has_tag_name("box") && node.has_attribute("xtl")) {
            let seen = attribute(&outline, "outside") != "1";
            let edges =
                EDGES.map(|(from, name)| field(name, if seen { attribute(&outline, from) } else { "" }));
            table.push(
                [field("id", attribute(&track, "id")), field("frame", attribute(&outline, "frame"))]
                    .into_iter()
                    .chain(edges),
            );
        }
    }
    (table.len() > 0).then_some(table)
}

/// Spots and the edges between them.
fn of_model(document: &Document) -> Option<RecordTable> {
    let frame = |spot: &Node| attribute(spot, "FRAME").parse::<i64>().unwrap_or(0);
    let mut spots: Vec<Node> =
        document.descendants().filter(|n| n.has_tag_name("Spot") && n.has_attribute("FRAME")).collect();
    spots.sort_by_key(frame);
    let places: BTreeMap<&str, usize> =
        spots.iter().enumerate().map(|(at, spot)| (attribute(spot, "ID"), at)).collect();
    let mut before: BTreeMap<usize, usize> = BTreeMap::new();
    let mut linked = vec![false; spots.len()];
    for edge in document.descendants().filter(|node| node.has_tag_name("Edge")) {
        let [source, target] =
            ["SPOT_SOURCE_ID", "SPOT_TARGET_ID"].map(|name| places.get(attribute(&edge, name)));
        let (Some(source), Some(target)) = (source, target) else { continue };
        let (early, late) = if source < target { (*source, *target) } else { (*target, *source) };
        before.entry(late).or_insert(early);
        [early, late].into_iter().for_each(|at| linked.get_mut(at).into_iter().for_each(|is| *is = true));
    }
    let model = document.descendants().find(|node| node.has_tag_name("Model"));
    let unit = unit(model.and_then(|model| model.attribute("spatialunits")));
    let (mut table, mut owners) = (RecordTable::default(), vec![None; spots.len()]);
    let (mut continued, mut objects) = (vec![false; spots.len()], 0usize);
    for (at, spot) in spots.iter().enumerate().filter(|(at, _)| linked.get(*at) == Some(&true)) {
        let from = before.get(&at).copied().filter(|from| continued.get(*from) == Some(&false));
        let owner = from.and_then(|from| {
            continued.get_mut(from).into_iter().for_each(|is| *is = true);
            owners.get(from).copied().flatten()
        });
        let owner = owner.unwrap_or_else(|| {
            objects += 1;
            objects - 1
        });
        owners.get_mut(at).into_iter().for_each(|known| *known = Some(owner));
        table.push([
            field("id", owner.to_string()),
            field("frame", attribute(spot, "FRAME")),
            field(&format!("x{unit}"), attribute(spot, "POSITION_X")),
            field(&format!("y{unit}"), attribute(spot, "POSITION_Y")),
        ]);
    }
    let image = document.descendants().find(|node| node.has_tag_name("ImageData"));
    let interval = image.and_then(|image| attribute(&image, "timeinterval").parse::<f64>().ok());
    let is_seconds = model.is_some_and(|model| matches!(model.attribute("timeunits"), Some("sec" | "s")));
    let rate = interval.filter(|interval| is_seconds && *interval > 0.0).map(|interval| 1.0 / interval);
    table.notes.extend(rate.map(|rate| format!("# fps: {rate}")));
    (table.len() > 0).then_some(table)
}
