//! Frames of the videos with what was seen drawn over them: outlines, tracks so far, and the residuals of the models.

use super::ReportData;
use super::chart::{Picture, PictureData, Series, line, px};
use super::plots::class;
use super::top_view::{colour, name};
use super::views::{PositionResidual, ReportViews};
use crate::media::{MAX_STILLS, Still};
use crate::num::{elementary, quantile};
use crate::perception::outline_of;
use crate::scene::{Camera, Sample, Scene};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

/// Width of a picture (px); that of a still of a wide video, so that nothing is interpolated.
const STILL_WIDTH: f64 = 480.0;
/// Most stills of a page (about 0.6 MB); each video has one at least.
const PAGE_STILLS: usize = 24;
/// Largest length of a magnified residual at the 90 % quantile (px).
const LENGTH: f64 = 24.0;
const MAGNIFICATIONS: [f64; 7] = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0];
/// Height of a line of text, its part below the letters, width of a letter, and distance from what it belongs to (px).
const TEXT_HEIGHT: f64 = 13.0;
const BELOW_LETTERS: f64 = 3.0;
const LETTER: f64 = 6.4;
const GAP: f64 = 4.0;

/// A still with what belongs to it.
struct AnnotatedStill<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    still: &'a Still,
    /// CSS class of each model, and its residuals in this video.
    models: Vec<(&'static str, &'a [PositionResidual])>,
    magnification: f64,
}

/// An object in a still.
struct SeenObject<'a> {
    index: usize,
    sample: &'a Sample,
    /// Its measured centre in the picture (px).
    centre: (f64, f64),
    outline: Vec<[f64; 2]>,
}

/// A residual in the image.
struct ImageResidual {
    class: &'static str,
    /// From the measured to the simulated centre (px of the video).
    shift: [f64; 2],
    /// Its length on the ground (m).
    ground: f64,
}

impl ImageResidual {
    fn pixels(&self) -> f64 {
        elementary::hypot(self.shift[0], self.shift[1])
    }
}

/// A rectangle in a picture (px).
#[derive(Clone, Copy)]
struct ImageBox {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl ImageBox {
    fn overlaps(&self, other: &ImageBox) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    /// A free place for a text of this width beside the box: to the right, to the left, above or below it. Where none is free,
    /// below all that is in the way.
    fn label(&self, wide: f64, taken: &[ImageBox]) -> ImageBox {
        let top = 0.5 * (self.top + self.bottom - TEXT_HEIGHT);
        let place =
            |left: f64, top: f64| ImageBox { left, top, right: left + wide, bottom: top + TEXT_HEIGHT };
        let middle = (0.5 * (self.left + self.right - wide)).clamp(0.0, (STILL_WIDTH - wide).max(0.0));
        let places = [
            place(self.right + GAP, top),
            place(self.left - GAP - wide, top),
            place(middle, self.top - GAP - TEXT_HEIGHT),
            place(middle, self.bottom + GAP),
        ];
        let is_free = |b: &ImageBox| {
            let is_inside = b.left >= 0.0 && b.right <= STILL_WIDTH && b.top >= 0.0;
            is_inside && !taken.iter().any(|other| b.overlaps(other))
        };
        let mut label = places.into_iter().find(is_free).unwrap_or(place(middle, top));
        // Each step leaves one of them behind for good, so that these are enough.
        for _ in 0..taken.len() {
            match taken.iter().find(|other| label.overlaps(other)) {
                Some(other) => label = place(label.left, other.bottom),
                None => break,
            }
        }
        label
    }
}

/// The stills of all videos.
pub fn all(report: &ReportData, views: &ReportViews) -> Vec<Picture> {
    let annotated = (0..report.scenes.len()).flat_map(|k| {
        let magnification = magnification(report, views, k);
        let stills = of_video(report, views, k).into_iter().enumerate();
        stills.map(move |(n, still)| AnnotatedStill { magnification, ..still }.picture(k, n))
    });
    annotated.collect()
}

/// The still of a video in which an object is farthest from where a model has it; the first without a model.
pub fn start(report: &ReportData, views: &ReportViews, video: usize) -> usize {
    let largest = |still: &AnnotatedStill| still.lengths().into_iter().fold(0.0, f64::max);
    let all: Vec<f64> = of_video(report, views, video).iter().map(largest).collect();
    (0..all.len()).rev().max_by(|&a, &b| all[a].total_cmp(&all[b])).unwrap_or(0)
}

/// How many times as long as they are the residuals of a video are drawn.
pub fn magnification(report: &ReportData, views: &ReportViews, video: usize) -> f64 {
    let stills = of_video(report, views, video);
    let mut lengths: Vec<f64> = stills.iter().flat_map(AnnotatedStill::lengths).collect();
    let typical = quantile(&mut lengths, 0.9).unwrap_or(LENGTH);
    MAGNIFICATIONS.into_iter().find(|m| m * typical <= LENGTH).unwrap_or(1.0)
}

/// The stills of a video that the page shows; none where no camera says where the objects are in the image.
fn of_video<'a>(report: &'a ReportData, views: &'a ReportViews, video: usize) -> Vec<AnnotatedStill<'a>> {
    let Some((scene, stills)) = report.scenes.get(video).zip(report.stills.get(video)) else { return vec![] };
    let Some(camera) = &scene.camera else { return vec![] };
    let most = (PAGE_STILLS / report.scenes.len().max(1)).clamp(1, MAX_STILLS);
    let stages = views.stages.len();
    let models = || {
        let of_stage = |(n, stage): (usize, &'a super::views::ModelStage)| {
            let class = if stages > 1 { class(stages, n) } else { "only" };
            Some((class, stage.residuals.get(video)?.as_slice()))
        };
        views.stages.iter().enumerate().filter_map(of_stage).collect()
    };
    let annotated = |k| {
        let (still, models) = (&stills[k], models());
        AnnotatedStill { scene, camera, still, models, magnification: 1.0 }
    };
    evenly(stills.len(), most).into_iter().map(annotated).collect()
}

/// Up to `most` of `count` indices at even distances.
fn evenly(count: usize, most: usize) -> Vec<usize> {
    match (count, most) {
        (count, most) if count <= most => (0..count).collect(),
        (count, 1) => vec![count / 2],
        (count, most) => (0..most).map(|k| k * (count - 1) / (most - 1)).collect(),
    }
}

impl AnnotatedStill<'_> {
    /// Pixels of the picture for one of the video.
    fn scale(&self) -> f64 {
        STILL_WIDTH / self.camera.image_size[0].max(1.0)
    }

    fn at(&self, [u, v]: [f64; 2]) -> (f64, f64) {
        (self.scale() * u, self.scale() * v)
    }

    /// The measured centre of an object in the picture.
    fn centre(&self, object: usize, sample: &Sample) -> Option<(f64, f64)> {
        let height = self.scene.objects.get(object)?.shape.centre_height();
        self.camera.project(sample.position, height).map(|pixel| self.at(pixel))
    }

    /// Lengths of the residuals of all objects and models in the picture (px).
    fn lengths(&self) -> Vec<f64> {
        let residuals = self.objects().into_iter().flat_map(|seen| self.residuals(&seen));
        residuals.map(|r| r.pixels() * self.scale()).filter(|length| length.is_finite()).collect()
    }

    fn objects(&self) -> Vec<SeenObject<'_>> {
        let seen = |index: usize| {
            let (object, track) = self.scene.objects.get(index).zip(self.scene.tracks.get(index))?;
            let sample = track.samples.iter().find(|s| s.frame == self.still.frame)?;
            let centre = self.centre(index, sample)?;
            let yaw = sample.yaw.unwrap_or(0.0);
            let outline = outline_of(self.camera, &object.shape, sample.position, yaw)?;
            Some(SeenObject { index, sample, centre, outline })
        };
        (0..self.scene.objects.len()).filter_map(seen).collect()
    }

    fn residuals(&self, seen: &SeenObject) -> Vec<ImageResidual> {
        let of_model = |(class, residuals): &(&'static str, &[PositionResidual])| {
            let found = residuals.iter().find(|r| r.object == seen.index && r.frame == self.still.frame)?;
            let mut simulated = *seen.sample;
            simulated.position.x -= found.off[0];
            simulated.position.y -= found.off[1];
            let (u, v) = self.centre(seen.index, &simulated)?;
            let shift = [(u - seen.centre.0) / self.scale(), (v - seen.centre.1) / self.scale()];
            Some(ImageResidual { class, shift, ground: found.size() })
        };
        self.models.iter().filter_map(of_model).collect()
    }

    fn picture(&self, video: usize, number: usize) -> Picture {
        let [width, height] = self.camera.image_size;
        let size = [STILL_WIDTH, STILL_WIDTH * height / width.max(1.0)];
        let objects = self.objects();
        let residuals: Vec<Vec<ImageResidual>> = objects.iter().map(|seen| self.residuals(seen)).collect();
        let labels = self.labels(&objects, &residuals);
        let body = html! {
            image href={ "data:image/jpeg;base64," (STANDARD.encode(&self.still.jpeg)) } width=(px(size[0])) height=(px(size[1]))
                preserveAspectRatio="none" {}
            @for k in 0..self.scene.objects.len() { (self.track(k)) }
            @for seen in &objects { (self.outline(seen)) }
            @for (seen, residuals) in objects.iter().zip(&residuals) { (self.arrows(seen, residuals)) }
            (labels)
        };
        let time = self.scene.time_of(self.still.frame);
        let seen = match objects.len() {
            0 => "no object".to_string(),
            1 => "the outline of 1 object".to_string(),
            n => format!("the outlines of {n} objects"),
        };
        Picture {
            name: format!("still-{}-{}", video + 1, number + 1),
            title: format!("{time:.2} s: frame {} with {seen}", self.still.frame),
            caption: String::new(),
            size,
            body,
            data: self.numbers(&objects, &residuals),
        }
    }

    /// The track of an object up to this frame.
    fn track(&self, object: usize) -> Markup {
        let samples = self.scene.tracks.get(object).into_iter().flat_map(|t| &t.samples);
        let (mut points, mut before) = (vec![], None);
        for sample in samples.take_while(|s| s.frame <= self.still.frame) {
            if before.is_some_and(|frame| sample.frame > frame + 1) {
                points.push(None);
            }
            points.push(self.centre(object, sample));
            before = Some(sample.frame);
        }
        let path = line(points.into_iter());
        let stroke = self.scene.objects.get(object).map_or("", |o| colour(&o.color, object));
        html! { path class="seen under" d=(path) {} path class="seen track" stroke=(stroke) d=(path) {} }
    }

    fn outline(&self, seen: &SeenObject) -> Markup {
        let path = line(seen.outline.iter().map(|p| Some(self.at(*p)))) + "Z";
        html! { path class="seen dark" d=(path) {} path class="seen outline" d=(path) {} }
    }

    /// From the measured to the simulated centre.
    fn arrows(&self, seen: &SeenObject, residuals: &[ImageResidual]) -> Markup {
        let (u, v) = seen.centre;
        let factor = self.magnification * self.scale();
        let path = |r: &ImageResidual| {
            line([Some((u, v)), Some((u + factor * r.shift[0], v + factor * r.shift[1]))].into_iter())
        };
        html! {
            @for r in residuals {
                path class="seen under" d=(path(r)) {}
                path class={ "seen residual " (r.class) } d=(path(r)) {}
            }
            circle class="seen centre" cx=(px(u)) cy=(px(v)) r="1.8" {}
        }
    }

    /// The number of each object beside it, with the residual of the last model.
    fn labels(&self, objects: &[SeenObject], residuals: &[Vec<ImageResidual>]) -> Markup {
        let boxes: Vec<ImageBox> = objects.iter().map(|seen| self.bounds(seen)).collect();
        let mut taken = boxes.clone();
        let mut all = vec![];
        for ((seen, residuals), own) in objects.iter().zip(residuals).zip(&boxes) {
            let id = self.scene.objects.get(seen.index).map_or(0, |o| o.id);
            let text = match residuals.last() {
                Some(r) => format!("{id}: {:.1} mm, {:.2} px", 1e3 * r.ground, r.pixels()),
                None => id.to_string(),
            };
            let label = own.label(LETTER * text.chars().count() as f64, &taken);
            taken.push(label);
            all.push((label.left, label.bottom - BELOW_LETTERS, text));
        }
        html! { @for (x, y, text) in &all { text class="seen" x=(px(*x)) y=(px(*y)) { (text) } } }
    }

    /// The part of the picture that the outline of an object takes.
    fn bounds(&self, seen: &SeenObject) -> ImageBox {
        let (x, y) = seen.centre;
        let centre = ImageBox { left: x, top: y, right: x, bottom: y };
        seen.outline.iter().map(|p| self.at(*p)).fold(centre, |b, (x, y)| ImageBox {
            left: b.left.min(x),
            top: b.top.min(y),
            right: b.right.max(x),
            bottom: b.bottom.max(y),
        })
    }

    /// The residuals of the last model.
    fn numbers(&self, objects: &[SeenObject], residuals: &[Vec<ImageResidual>]) -> PictureData {
        let series = objects.iter().zip(residuals).filter_map(|(seen, residuals)| {
            let (object, last) = self.scene.objects.get(seen.index).zip(residuals.last())?;
            let points = vec![(vec![1e3 * last.ground, last.pixels()], seen.centre)];
            Some(Series { name: name(object), points })
        });
        PictureData::new(&["residual (mm)", "residual (px)"], series.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stills_are_taken_evenly() {
        assert_eq!(evenly(3, 12), [0, 1, 2]);
        assert_eq!(evenly(12, 4), [0, 3, 7, 11]);
        assert_eq!(evenly(12, 1), [6]);
        assert_eq!(evenly(0, 1), Vec::<usize>::new());
    }

    #[test]
    fn a_label_covers_neither_objects_nor_labels() {
        let body = |left: f64| ImageBox { left, top: 100.0, right: left + 30.0, bottom: 140.0 };
        let bodies = [body(200.0), body(232.0), body(264.0)];
        let mut taken = bodies.to_vec();
        let places: Vec<(f64, f64)> = bodies
            .iter()
            .map(|own| {
                let label = own.label(90.0, &taken);
                assert!(taken.iter().all(|other| !label.overlaps(other)));
                taken.push(label);
                (label.left, label.top)
            })
            .collect();
        // To the left, above, and to the right.
        assert_eq!(places, [(106.0, 113.5), (202.0, 83.0), (298.0, 113.5)]);
        let crowd: Vec<ImageBox> = (0..40).map(|k| body(12.0 * k as f64)).collect();
        let label = crowd[20].label(90.0, &crowd);
        assert!(crowd.iter().all(|other| !label.overlaps(other)));
    }
}
