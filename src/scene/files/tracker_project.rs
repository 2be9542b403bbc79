//! Projects of Tracker (Open Source Physics): its XML (.trk), also in its archive (.trz), becomes a table of text.
//!
//! A point mass has one position (px) a frame. The coordinate system of the frame has an origin (px), an angle, and a scale
//! (px per unit of length); y points up.

use crate::num::elementary;
use crate::scene::files::archive;
use crate::scene::files::encoding::decode;
use crate::scene::violations::SceneError;
use roxmltree::{Document, Node, ParsingOptions};

/// Duration of a frame where a project states none (ms): that of a camera with 30 frames/s.
const DEFAULT_STEP_MS: f64 = 1000.0 / 30.0;

pub(super) fn is_archive(bytes: &[u8]) -> bool {
    archive::is_archive(bytes) && archive::entries(bytes).iter().any(|entry| entry.name.ends_with(b".trk"))
}

/// The XML of the project in an archive.
pub(super) fn unpacked(bytes: &[u8]) -> Result<String, SceneError> {
    let wrong =
        || SceneError::single("(file)", "is a damaged Tracker archive; unpack it and give its .trk file");
    let all = archive::entries(bytes);
    let entry = all.iter().find(|entry| entry.name.ends_with(b".trk")).ok_or_else(wrong)?;
    let content = || Some(decode(&entry.content(bytes)?).ok()?.text);
    content().ok_or_else(wrong)
}

/// The property of an object with this name.
fn property<'a, 'i>(of: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    of.children().find(|child| child.has_tag_name("property") && child.attribute("name") == Some(name))
}

fn value(of: Node, name: &str) -> Option<f64> {
    property(of, name)?.text()?.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// The items `[0]`, `[1]` ... of an array, each with its index.
fn items<'a, 'i>(array: Node<'a, 'i>) -> impl Iterator<Item = (usize, Node<'a, 'i>)> {
    array.children().filter_map(|item| {
        let index = item.attribute("name")?.trim_matches(['[', ']']).parse().ok()?;
        Some((index, item.children().find(|child| child.has_tag_name("object"))?))
    })
}

/// The coordinate system of one frame.
#[derive(Clone, Copy)]
struct ImageAxes {
    origin: [f64; 2],
    /// Radians, counter-clockwise.
    angle: f64,
    /// Pixels per unit of length.
    scale: [f64; 2],
}

impl ImageAxes {
    fn position(&self, x: f64, y: f64) -> [f64; 2] {
        let (right, up) = (x - self.origin[0], self.origin[1] - y);
        let (cos, sin) = (elementary::cos(self.angle), elementary::sin(self.angle));
        [(right * cos + up * sin) / self.scale[0], (up * cos - right * sin) / self.scale[1]]
    }
}

/// The coordinate systems of the frames from the first one on; one holds up to the next.
fn axes(root: Node) -> Vec<(usize, ImageAxes)> {
    let frames =
        property(root, "coords").and_then(|coords| object(coords)).and_then(|c| property(c, "framedata"));
    let one = |(frame, data): (usize, Node)| {
        let scale = |axis: &str| value(data, axis).filter(|v| *v > 0.0).unwrap_or(1.0);
        let origin = [value(data, "xorigin").unwrap_or(0.0), value(data, "yorigin").unwrap_or(0.0)];
        let angle = value(data, "xangle").unwrap_or(0.0).to_radians();
        (frame, ImageAxes { origin, angle, scale: [scale("xscale"), scale("yscale")] })
    };
    frames.map(|frames| items(frames).map(one).collect()).unwrap_or_default()
}

fn object<'a, 'i>(of: Node<'a, 'i>) -> Option<Node<'a, 'i>> {
    of.children().find(|child| child.has_tag_name("object"))
}

/// The positions of a project as a table: id, t, x, y, mass.
pub(super) fn table(text: &str) -> Result<String, SceneError> {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|e| {
        SceneError::single(
            "(file)",
            format!("is no XML that can be read: {e}; save the project again in Tracker"),
        )
    })?;
    let is_panel = |node: &Node| {
        node.has_tag_name("object")
            && node.attribute("class").is_some_and(|class| class.ends_with("TrackerPanel"))
    };
    let Some(panel) = document.descendants().find(is_panel) else {
        let message = "is XML, but no project of Tracker; give CSV, or a .trk file with one video";
        return Err(SceneError::single("(file)", message));
    };
    let axes = axes(panel);
    let clip = property(panel, "clip").and_then(object);
    let start = clip.and_then(|clip| value(clip, "startframe")).unwrap_or(0.0);
    let control = property(panel, "clipcontrol").and_then(object);
    let step = control.and_then(|c| value(c, "delta_t")).filter(|v| *v > 0.0).unwrap_or(DEFAULT_STEP_MS);
    let mut table = String::from("id,t [s],x,y,mass\n");
    let tracks =
        property(panel, "tracks").into_iter().flat_map(|tracks| tracks.children()).filter_map(object);
    let masses = tracks.filter(|t| t.attribute("class").is_some_and(|class| class.ends_with("PointMass")));
    for (number, track) in masses.enumerate() {
        let name = property(track, "name").and_then(|n| n.text()).map(|name| name.replace(['"', '\n'], " "));
        let name = name.unwrap_or_else(|| number.to_string());
        let mass =
            value(track, "mass").filter(|mass| *mass > 0.0).map(|mass| mass.to_string()).unwrap_or_default();
        for (frame, data) in property(track, "framedata").into_iter().flat_map(items) {
            let (Some(u), Some(v)) = (value(data, "x"), value(data, "y")) else { continue };
            let of_frame = axes.iter().rev().find(|(from, _)| *from <= frame).or(axes.first());
            let Some((_, axes)) = of_frame else {
                let message = "has no coordinate system; set the axes and a calibration stick in Tracker";
                return Err(SceneError::single("coords", message));
            };
            let [x, y] = axes.position(u, v);
            let time = (frame as f64 - start) * step / 1000.0;
            table += &format!("\"{name}\",{time},{x},{y},{mass}\n");
        }
    }
    match table.lines().nth(1) {
        Some(_) => Ok(table),
        None => Err(SceneError::single("tracks", "have no point mass with positions; track one in Tracker")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROJECT: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
 <property name="clip" type="object"><object class="org.opensourcephysics.media.core.VideoClip">
  <property name="startframe" type="int">1</property></object></property>
 <property name="clipcontrol" type="object"><object class="org.opensourcephysics.media.core.StepperClipControl">
  <property name="delta_t" type="double">20.0</property></object></property>
 <property name="coords" type="object"><object class="org.opensourcephysics.media.core.ImageCoordSystem">
  <property name="framedata" type="array" class="[Lx;"><property name="[0]" type="object"><object class="x">
   <property name="xorigin" type="double">100.0</property><property name="yorigin" type="double">200.0</property>
   <property name="xangle" type="double">0.0</property>
   <property name="xscale" type="double">50.0</property><property name="yscale" type="double">50.0</property>
  </object></property></property></object></property>
 <property name="tracks" type="collection" class="java.util.ArrayList">
  <property name="item" type="object"><object class="org.opensourcephysics.cabrillo.tracker.PointMass">
   <property name="mass" type="double">0.5</property><property name="name" type="string">mass A</property>
   <property name="framedata" type="array" class="[Lx;">
    <property name="[1]" type="object"><object class="x"><property name="x" type="double">150.0</property><property name="y" type="double">200.0</property></object></property>
    <property name="[2]" type="object"><object class="x"><property name="x" type="double">160.0</property><property name="y" type="double">150.0</property></object></property>
   </property></object></property></property></object>"#;

    #[test]
    fn a_project_becomes_a_table_in_its_coordinate_system() {
        let table = table(PROJECT).unwrap();
        assert_eq!(table, "id,t [s],x,y,mass\n\"mass A\",0,1,0,0.5\n\"mass A\",0.02,1.2,1,0.5\n");
    }

    #[test]
    fn an_archive_is_unpacked() {
        let packed = miniz_oxide::deflate::compress_to_vec(PROJECT.as_bytes(), 6);
        let (size, name) = (packed.len() as u32, b"p.trk");
        let sizes = [size.to_le_bytes(), (PROJECT.len() as u32).to_le_bytes()].concat();
        let local =
            [&b"PK\x03\x04\x14\0\0\0\x08\0\0\0\0\0\0\0\0\0"[..], &sizes, &[5, 0, 0, 0], name, &packed]
                .concat();
        let head =
            [&b"PK\x01\x02\x14\0\x14\0\0\0\x08\0\0\0\0\0\0\0\0\0"[..], &sizes, &[5, 0, 0, 0, 0, 0], &[0; 12]]
                .concat();
        let at = (local.len() as u32).to_le_bytes();
        let end = [&b"PK\x05\x06\0\0\0\0\x01\0\x01\0\0\0\0\0"[..], &at, &[0, 0]].concat();
        let archive = [&local[..], &head, name, &end].concat();
        assert!(is_archive(&archive));
        assert_eq!(unpacked(&archive).unwrap(), PROJECT);
        for cut in 0..archive.len() {
            let _ = unpacked(&archive[..cut]);
        }
        assert!(unpacked(&archive[..60]).unwrap_err().to_string().contains("damaged"));
    }

    #[test]
    fn other_xml_is_refused() {
        for wrong in ["<", "<a/>", "<object class='TrackerPanel'/>"] {
            assert!(table(wrong).is_err(), "{wrong}");
        }
    }
}
