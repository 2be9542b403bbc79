//! Video files: options to what perception takes, and its report back.

use super::camera::camera;
use crate::api::convert::video::world;
use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::EngineError;
use crate::media::Video;
use crate::perception::{PerceptionOptions, PerceptionReport, View};
use crate::scene::{SIZE_RANGE, Table};

/// Sizes of a pixel (m).
const PIXEL_RANGE: [f64; 2] = [1e-6, 10.0];

/// The set-up, and what perception takes; or all violations at once.
pub fn options(
    given: v1::ImportVideoOptions,
    background: &[u8],
) -> Result<(Option<String>, PerceptionOptions), EngineError> {
    let mut r = Violations::default();
    let camera = given.camera.and_then(|given| camera(&mut r, given));
    let number = |r: &mut Violations, name: &str, value: f64, [low, high]: [f64; 2]| -> Option<f64> {
        if value != 0.0 && !(low..=high).contains(&value) {
            r.add(format!("options.{name}"), format!("is {value}; it must be {low} to {high}, or 0"));
        }
        Some(value).filter(|v| *v != 0.0)
    };
    let scale = number(&mut r, "metres_per_pixel", given.metres_per_pixel, PIXEL_RANGE);
    let radius = number(&mut r, "ball_radius", given.ball_radius, SIZE_RANGE);
    let size = number(&mut r, "object_size", given.object_size, SIZE_RANGE);
    let stated = (given.world != 0).then(|| world(&mut r, "options.world", given.world));
    let background = (!background.is_empty()).then(|| Video::first_frame(background.to_vec()));
    let background = background.transpose().unwrap_or_else(|e| {
        r.add("background", e.to_string());
        None
    });
    let name = if given.display_name.is_empty() { "video".into() } else { given.display_name };
    let view = camera.map_or(View::Above { scale }, View::Calibrated);
    let usual = PerceptionOptions::of_view(name, view, radius, size);
    let options = PerceptionOptions {
        world: stated.unwrap_or(usual.world),
        table: given.table.map(|t| Table { x: [t.x_min, t.x_max], y: [t.y_min, t.y_max] }),
        background,
        ..usual
    };
    r.finish((Some(given.setup).filter(|s| !s.is_empty()), options))
}

pub fn report_message(report: &PerceptionReport) -> v1::PerceptionReport {
    let object = |o: &crate::perception::PerceivedObject| v1::PerceivedObject {
        id: o.id,
        shape_probability: o.shape_probability,
        color_probability: o.color_probability,
        material_probability: o.material_probability,
        frames_placed: o.frames_placed as u32,
        outline_residual: o.outline_residual,
    };
    let region = |u: &crate::perception::UnexplainedRegion| {
        let [left, top, right, bottom] = u.bounds.map(|v| v as f64);
        v1::UnexplainedRegion {
            first_frame: u.first_frame as u32,
            last_frame: u.last_frame as u32,
            r#box: Some(v1::Box { left, top, width: right - left, height: bottom - top }),
            pixels: u.pixels as u32,
        }
    };
    v1::PerceptionReport {
        format: report.format.clone(),
        frames: report.frames as u32,
        merged: report.merged as u32,
        hidden: report.hidden as u32,
        objects: report.objects.iter().map(object).collect(),
        unexplained: report.unexplained.iter().map(region).collect(),
        warnings: report.warnings.clone(),
    }
}
