//! Writes a scene as our table: one row an object and frame.

use crate::scene::object::Shape;
use crate::scene::observation::Scene;
use crate::scene::violations::SceneError;
use ::csv::{Terminator, WriterBuilder};

/// The columns, in SI units.
const HEADER: [&str; 10] =
    ["id", "t [s]", "x [m]", "y [m]", "yaw [rad]", "shape", "size [m]", "mass [kg]", "material", "color"];

/// The table of a scene: reading it gives the scene again, but for its camera and its covariances.
pub fn written_csv(scene: &Scene) -> Result<String, SceneError> {
    let mut notes = format!("# world: {}\n# fps: {}\n", scene.world.name(), scene.fps);
    notes.extend(scene.setup.iter().map(|setup| format!("# setup: {setup}\n")));
    let cushions =
        |t: &crate::scene::Table| format!("# table: {} {} {} {}\n", t.x[0], t.x[1], t.y[0], t.y[1]);
    notes.extend(scene.table.iter().map(cushions));
    let mut table = WriterBuilder::new().terminator(Terminator::Any(b'\n')).from_writer(vec![]);
    let failed = |e: ::csv::Error| SceneError::single("(file)", e.to_string());
    table.write_record(HEADER).map_err(failed)?;
    let mut samples: Vec<_> =
        (0..scene.objects.len()).map(|k| scene.all_samples(k).into_iter().peekable()).collect();
    for (frame, time) in scene.times.iter().enumerate() {
        let mut is_empty = true;
        for (object, samples) in scene.objects.iter().zip(&mut samples) {
            let Some(sample) = samples.next_if(|s| s.frame == frame) else { continue };
            is_empty = false;
            let (word, size) = match object.shape {
                Shape::Disc { radius } => ("disc", radius),
                Shape::Ball { radius } => ("ball", radius),
                Shape::Square { half_side } => ("cube", half_side),
                Shape::Rectangle { .. } => {
                    let message = "is a box, which a table cannot hold; use `vrdp import`";
                    return Err(SceneError::single(format!("object {}: shape", object.id), message));
                }
            };
            let yaw = sample.yaw.map(|yaw| yaw.to_string()).unwrap_or_default();
            let mass = object.mass.map(|mass| mass.to_string()).unwrap_or_default();
            let [x, y] = [sample.position.x, sample.position.y].map(|v| v.to_string());
            let (id, time, size) = (object.id.to_string(), time.to_string(), size.to_string());
            table
                .write_record([&id, &time, &x, &y, &yaw, word, &size, &mass, &object.material, &object.color])
                .map_err(failed)?;
        }
        // A frame in which nothing was seen keeps its time.
        if let Some(object) = scene.objects.first().filter(|_| is_empty) {
            let (id, time) = (object.id.to_string(), time.to_string());
            table.write_record([&id, &time, "", "", "", "", "", "", "", ""]).map_err(failed)?;
        }
    }
    let bytes = table.into_inner().map_err(|e| SceneError::single("(file)", e.to_string()))?;
    Ok(notes + &String::from_utf8_lossy(&bytes))
}
