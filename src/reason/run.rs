//! Runs a program on the events of one rollout and keeps its derivation: each step and its result in words.
//!
//! Without interventions, `events` are those within the frames of the video, `unseen_events` those after it. Entrances, exits
//! and visibility within the video are observed (the tracks); collisions, speeds, and everything after the video are
//! simulated. `filter_counterfact` takes the events under interventions within the frames of the video, as CLEVRER's questions do.
//! If that scenario is not simulated yet, the run ends with [`Halt::NeedsSimulation`]; the caller simulates it and starts again.

use super::context::{Halt, RolloutContext};
use super::describe::describe;
use super::program::{Op, QuestionProgram};
use super::step::step;
use super::value::ProgramValue;
use serde::{Deserialize, Serialize};

/// One step of a program: its token and its result in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DerivationStep {
    pub token: String,
    pub result: String,
}

/// Runs a checked program on top of `stack`. Returns the stack, and on the best rollout the derivation.
pub fn run(
    program: &QuestionProgram,
    context: RolloutContext,
    mut stack: Vec<ProgramValue>,
) -> Result<(Vec<ProgramValue>, Vec<DerivationStep>), Halt> {
    let mut derivation = vec![];
    let mut words: Vec<&str> = vec![];
    for (op, token) in program.ops.iter().zip(&program.tokens) {
        match op {
            Op::Objects => words.clear(),
            Op::Color(w) | Op::Material(w) | Op::Shape(w) => words.push(w),
            _ => {}
        }
        let value = step(*op, context, &mut stack, &words)?;
        // Only the best rollout's derivation is shown, and describing a value costs more than the step.
        if context.rollout == 0 {
            derivation.push(DerivationStep { token: token.clone(), result: describe(context.scene, &value) });
        }
        stack.push(value);
    }
    Ok((stack, derivation))
}
