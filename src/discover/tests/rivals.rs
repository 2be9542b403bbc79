//! What is no physics, but looks like some: a mass, a scale, a camera, a marker, a size.

use super::super::negligible::is_slight;
use super::*;

/// Objects of which the first meets others in each video, and turns.
fn meetings() -> Vec<Vec<Launch>> {
    vec![
        vec![(DISC, 0.6, [-1.0, 0.0], [1.0, 0.0]), (DISC, 0.8, [0.4, 0.1], [-0.4, 0.0])],
        vec![(CUBE, 0.8, [0.0, -1.2], [0.1, 1.1]), (DISC, 0.9, [0.1, 0.3], [0.0, -0.3])],
        vec![(CUBE, 1.0, [0.9, -0.8], [-0.8, 0.7]), (DISC, 0.6, [-0.3, 0.3], [0.3, -0.2])],
        vec![
            (DISC, 0.6, [-1.0, 0.0], [1.2, 0.0]),
            (DISC, 0.7, [0.5, 1.2], [-0.3, -0.6]),
            (CUBE, 0.7, [0.4, 0.1], [-0.4, 0.0]),
        ],
    ]
}

/// The only effect that is found, by its parameters.
fn found_in(scenes: &[Scene], effect: &str) -> impl Fn(&str) -> ParameterValue + use<> {
    let found = discover(scenes, &models(scenes), &DiscoverOptions::default(), &never).expect("it runs");
    let names: Vec<&str> = found.effects.iter().map(|e| e.effect.as_str()).collect();
    assert_eq!((found.verdict, &names[..]), (Verdict::EffectFound, &[effect][..]), "{}", found.reason);
    let told = found.effects[0].parameters.clone();
    move |name| told.iter().find(|p| p.name == name).expect(name).value.clone()
}

fn number(value: ParameterValue) -> f64 {
    let ParameterValue::Number(value) = value else { panic!("{value:?} is a number") };
    value
}

fn vector(value: ParameterValue) -> Vec2 {
    let ParameterValue::Vector([x, y]) = value else { panic!("{value:?} is a vector") };
    vec2(x, y)
}

#[test]
fn an_object_heavier_than_believed_is_told_from_a_law_of_contact() {
    let told = found_in(&heavier_than_believed(), "mass_change");
    assert_eq!(number(told("object_id")), 1.0);
    assert!((number(told("factor")) - 2.0).abs() < 0.15);
}

#[test]
fn a_wrong_scale_shows_where_objects_touch() {
    let told = found_in(&film(&meetings(), Some(("wrong_scale", &[("excess", 0.08)]))), "wrong_scale");
    assert!((number(told("scale")) - 1.08).abs() < 0.01);
}

#[test]
fn a_wrong_size_is_told_with_its_object() {
    let mut scenes = film(&meetings(), None);
    scenes.iter_mut().for_each(|s| s.objects[1].shape = Shape::Disc { radius: 0.16 });
    let told = found_in(&scenes, "wrong_size");
    assert_eq!(number(told("object_id")), 1.0);
    assert!((number(told("factor")) - 1.25).abs() < 0.04);
}

#[test]
fn a_tilted_camera_is_no_force() {
    let law: (&str, &[(&str, f64)]) = ("tilted_camera", &[("h_x", 0.04), ("h_y", -0.03)]);
    let told = found_in(&film(&launches(), Some(law)), "tilted_camera");
    assert!((vector(told("h")) - vec2(0.04, -0.03)).norm() < 0.01);
}

#[test]
fn a_marker_off_the_centre_is_told_with_its_object() {
    let arm = vec2(0.03, 0.04);
    let scenes = film_under(&meetings(), |model| {
        let spec = &effect("off_centre_marker").expect("it is there").spec;
        let mut active = ActiveEffect::new(spec, &model.bodies);
        active.parameters.iter_mut().zip([arm.x, arm.y]).for_each(|(p, v)| p.values[0] = v);
        model.effects.push(active);
    });
    let told = found_in(&scenes, "off_centre_marker");
    assert_eq!(number(told("object_id")), 0.0);
    assert!((vector(told("arm")) - arm).norm() < 0.01);
}

#[test]
fn what_engines_do_at_contacts_anyway_is_no_wrong_scale() {
    let slight =
        |name: &str, amplitude: f64| is_slight(effect(name).expect("it is there"), &[amplitude], &[], &[]);
    assert!(slight("wrong_scale", -0.005) && !slight("wrong_scale", -0.03));
    assert!(!slight("sticky_contact", 0.001));
}
