//! A program in English: each operation's line of the table with its operands filled in.

use super::program::{Op, QuestionProgram, apply};
use crate::reason::types::{MOMENT, Type};

/// What the program asks, such as "speed of the gray sphere at the end of the video".
pub fn read_back(program: &QuestionProgram) -> String {
    let mut stack: Vec<String> = vec![];
    let mut types: Vec<Type> = vec![];
    let mut supposed = String::new();
    for (op, token) in program.ops.iter().zip(&program.tokens) {
        let operation = match op {
            Op::Call(operation) => operation,
            Op::Push(kind, _) => {
                stack.push(token.rsplit(':').next().unwrap_or(token).to_string());
                types.push(*kind);
                continue;
            }
        };
        let has_moment = operation.may_take_moment && types.last().is_some_and(|t| MOMENT.1.contains(t));
        let moment = if has_moment { stack.pop() } else { None };
        // A program that the check refuses has no types from there on.
        if apply(op, &mut types).is_err() {
            types.clear();
        }
        let mut text = operation.reads.to_string();
        for k in 0..operation.takes.len() {
            let operand = stack.pop().unwrap_or_default();
            text = text.replace(&format!("{{{k}}}"), &operand);
        }
        text += &moment.map_or(String::new(), |moment| format!(" at {moment}"));
        let text =
            text.replace("rest at any time", "never move").replace("that move at any time", "that ever move");
        match operation.token {
            "suppose" => supposed = format!(", {text}"),
            // What was read under the change says so; what follows is without it.
            "actual" => {
                if let Some(last) = stack.last_mut() {
                    last.push_str(&supposed);
                }
                supposed.clear();
            }
            "unique" => stack.push(only(&text)),
            "filter_shape" => stack.push(shaped(&text)),
            "filter_counterfact" => {
                let is_events = |s: &String| s.ends_with("events") || s.contains("event of");
                if stack.last().is_some_and(is_events) {
                    stack.pop();
                }
                stack.push(text);
            }
            _ => stack.push(text),
        }
    }
    stack.join("; ") + &supposed
}

/// "the red cubes" as one object: "the red cube".
fn only(text: &str) -> String {
    let is_objects = !text.contains("collision") && !text.contains(" enter") && !text.contains(" exit");
    match text.strip_suffix('s').filter(|_| is_objects) {
        Some(one) => one.to_string(),
        None => text.to_string(),
    }
}

/// "cube red objects" as "red cubes".
fn shaped(text: &str) -> String {
    let (shape, objects) = text.split_once(' ').unwrap_or((text, "objects"));
    match objects.strip_suffix("objects") {
        Some(before) => format!("{before}{shape}s"),
        None => text.to_string(),
    }
}
