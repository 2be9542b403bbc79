//! Runs a program on the events of one rollout and keeps its derivation: each step and its result in words.
//!
//! Without interventions, `events` are those within the frames of the video, `unseen_events` those after it. Entrances, exits
//! and visibility within the video are observed (the tracks); collisions, speeds, and everything after the video are
//! simulated. `filter_counterfact` takes the events under interventions within the frames of the video, as CLEVRER's questions do;
//! `suppose` sets a change for all that follows, with the same spans as without one. If a scenario is not simulated yet, the run
//! ends with [`Halt::NeedsSimulation`]; the caller simulates it and starts again.

use super::context::{Halt, RolloutContext};
use super::describe::describe;
use super::language::{Op, QuestionProgram};
use super::operations::Machine;
use super::types::Gives;
use super::value::ProgramValue;
use serde::{Deserialize, Serialize};

/// One step of a program: its token and its result in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DerivationStep {
    pub token: String,
    pub result: String,
}

/// The result of one operation on a stack, from which it takes its operands; a word is its own result.
pub fn step(op: &Op, context: RolloutContext, stack: &mut Vec<ProgramValue>) -> Result<ProgramValue, Halt> {
    match op {
        Op::Push(_, value) => Ok(value.clone()),
        Op::Call(operation) => {
            let own = std::mem::take(stack);
            let mut machine =
                Machine { context, stack: own, operation: Some(operation), words: vec![], supposed: vec![] };
            let result = (operation.run)(&mut machine);
            *stack = machine.stack;
            result
        }
    }
}

/// Runs a checked program on top of `stack`. Returns the stack, and on the best rollout the derivation.
pub fn run(
    program: &QuestionProgram,
    context: RolloutContext,
    stack: Vec<ProgramValue>,
) -> Result<(Vec<ProgramValue>, Vec<DerivationStep>), Halt> {
    let mut derivation = vec![];
    let mut machine = Machine { context, stack, operation: None, words: vec![], supposed: vec![] };
    for (op, token) in program.ops.iter().zip(&program.tokens) {
        let value = match op {
            Op::Push(_, value) => value.clone(),
            Op::Call(operation) => {
                machine.operation = Some(operation);
                (operation.run)(&mut machine)?
            }
        };
        let is_kept = !matches!(op, Op::Call(o) if o.gives == Gives::Nothing);
        // Only the best rollout's derivation is shown, and describing a value costs more than the step.
        if context.rollout == 0 {
            let result = match is_kept {
                true => describe(context.scene, &value),
                false => super::describe::describe_changes(context.scene, &machine.supposed),
            };
            derivation.push(DerivationStep { token: token.clone(), result });
        }
        if is_kept {
            machine.stack.push(value);
        }
    }
    Ok((machine.stack, derivation))
}
