//! The questions of a crowded scene as programs, and their values on the events of a rollout.

use vrdp::reason::{
    Gives, Op, ProgramValue, QuestionProgram, RolloutContext, RolloutEvents, SceneEventKind, ops, step,
};
use vrdp::scene::{Object, Scene};

pub struct Asked {
    pub kind: &'static str,
    pub program: String,
    /// Programs of the choices; none of an open question.
    pub choices: Vec<String>,
}

/// "objects red filter_color metal filter_material cube filter_shape unique".
fn object(object: &Object) -> String {
    let Object { color, material, shape, .. } = object;
    format!("objects {color} filter_color {material} filter_material {} filter_shape unique", shape.word())
}

fn pair(scene: &Scene, [a, b]: [usize; 2]) -> String {
    let [a, b] = [a, b].map(|k| object(&scene.objects[k]));
    format!("all_events {a} filter_collision {b} filter_collision unique")
}

/// The questions that the true events of a scene make sense of.
pub fn questions(scene: &Scene, truth: &RolloutEvents) -> Vec<Asked> {
    let mut all = vec![];
    let mut open = |program: String| all.push(Asked { kind: "descriptive", program, choices: vec![] });
    for kind in ["filter_collision", "filter_in", "filter_out"] {
        open(format!("events objects {kind} count"));
    }
    for shape in ["cube", "sphere", "cylinder"] {
        let shape = format!("objects {shape} filter_shape");
        open(format!("{shape} events filter_end query_frame filter_moving count"));
        open(format!("{shape} events filter_start query_frame filter_stationary count"));
        open(format!("events {shape} filter_collision count"));
    }
    let hits: Vec<_> = truth
        .events
        .iter()
        .filter(|e| e.kind == SceneEventKind::Collision && e.frame < scene.times.len())
        .collect();
    for one in &scene.objects {
        let one = object(one);
        open(format!("events {one} filter_collision exist"));
        open(format!("events objects filter_in events {one} filter_in unique filter_before count"));
        open(format!("events objects filter_collision events {one} filter_in unique filter_after count"));
        for order in ["first", "last"] {
            open(format!(
                "events {one} filter_collision {order} filter_order {one} query_collision_partner query_color"
            ));
        }
    }
    for hit in &hits {
        let [a, b] = [hit.objects[0], hit.objects[1]];
        let others = hits.iter().filter(|e| e.objects != hit.objects);
        let mut choices: Vec<String> = others.map(|e| pair(scene, [e.objects[0], e.objects[1]])).collect();
        choices.extend(
            (0..scene.objects.len()).filter(|k| ![a, b].contains(k)).map(|k| object(&scene.objects[k])),
        );
        let [a, b] = [a, b].map(|k| object(&scene.objects[k]));
        let program = format!(
            "events events {a} filter_collision {b} filter_collision unique filter_ancestor belong_to"
        );
        all.push(Asked { kind: "explanatory", program, choices });
    }
    let pairs = || {
        let n = scene.objects.len();
        (0..n).flat_map(move |b| (0..b).map(move |a| [a, b]))
    };
    let without = |k: usize| pairs().filter(|p| !p.contains(&k)).map(|p| pair(scene, p)).collect();
    let choices = pairs().map(|p| pair(scene, p)).collect();
    all.push(Asked { kind: "predictive", program: "unseen_events belong_to".into(), choices });
    for (k, one) in scene.objects.iter().enumerate() {
        let one = object(one);
        let program = format!("all_events {one} filter_counterfact belong_to");
        all.push(Asked { kind: "counterfactual", program, choices: without(k) });
        for change in ["apply_heavier", "apply_lighter"] {
            let program = format!("all_events {one} {change} filter_counterfact belong_to");
            all.push(Asked {
                kind: "counterfactual mass",
                program,
                choices: pairs().map(|p| pair(scene, p)).collect(),
            });
        }
    }
    all
}

/// The value of programs that are run one after the other; `None` where the rollout has none.
pub fn value(programs: &[&str], context: RolloutContext) -> Option<ProgramValue> {
    let mut stack = vec![];
    for program in programs {
        let tokens: Vec<String> = program.split(' ').map(str::to_string).collect();
        for op in QuestionProgram::parse(&tokens).ok()?.ops {
            let value = step(&op, context, &mut stack).ok()?;
            let is_kept = !matches!(&op, Op::Call(o) if o.gives == Gives::Nothing);
            stack.extend(is_kept.then_some(value));
        }
    }
    stack.pop()
}

/// Whether two objects collide in the video, or until the end of the simulation.
pub fn collide(events: &RolloutEvents, pair: [usize; 2], until: usize) -> bool {
    ops::filter_kind(&events.events, SceneEventKind::Collision, &[pair[0]])
        .iter()
        .any(|e| e.objects.contains(&pair[1]) && e.frame < until)
}
