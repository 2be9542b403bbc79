//! A JSON schema and a GBNF grammar of programs, generated from the table of operations, for any language model as the parser.
//!
//! Both fix the vocabulary; the types of operands are checked by [`QuestionProgram::check`], which names the first mismatch.

use super::program::{QuestionProgram, known_words};
use crate::reason::operations::{OPERATIONS, signature_words};
use serde_json::{Value, json};

/// Pattern of a number, and of a scene's own word such as `color:teal`.
const NUMBER_PATTERN: &str = "[0-9]+(\\.[0-9]+)?";
const OWN_WORD: &str = "(color|material|shape):[a-z]+";

/// JSON schema (draft 2020-12) of `{"program": [token, ...]}`.
pub fn json_schema() -> Value {
    let names = OPERATIONS
        .iter()
        .map(|o| json!({ "const": o.token, "description": format!("{}: {}", signature_words(o), o.line()) }));
    let words = known_words().map(|(word, kind)| json!({ "const": word, "description": kind.name() }));
    let mut tokens: Vec<Value> = names.chain(words).collect();
    tokens.push(
        json!({ "type": "string", "pattern": format!("^{NUMBER_PATTERN}$"), "description": "a number" }),
    );
    tokens.push(json!({
        "type": "string", "pattern": format!("^{OWN_WORD}$"), "description": "a word of the scene's own"
    }));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "vrdp question program",
        "type": "object",
        "properties": {
            "program": {
                "type": "array",
                "description": "tokens in postfix order: operands come before their operation",
                "items": { "anyOf": tokens },
                "minItems": 1,
                "maxItems": QuestionProgram::MAX_TOKENS,
            }
        },
        "required": ["program"],
        "additionalProperties": false,
    })
}

/// GBNF grammar (llama.cpp) of a program: tokens with one space between.
pub fn gbnf_grammar() -> String {
    let quoted = |words: Vec<&str>| words.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(" | ");
    let operations = quoted(OPERATIONS.iter().map(|o| o.token).collect());
    let words = quoted(known_words().map(|(word, _)| word).collect());
    format!(
        "root ::= token (\" \" token)*\ntoken ::= operation | word | number | own\noperation ::= {operations}\n\
         word ::= {words}\nnumber ::= [0-9]+ (\".\" [0-9]+)?\n\
         own ::= (\"color:\" | \"material:\" | \"shape:\") [a-z]+\n"
    )
}
