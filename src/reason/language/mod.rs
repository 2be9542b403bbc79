//! The language of programs: tokens and types, the program in English, and the schema and grammar for language models.

mod program;
mod read_back;
mod schema;

pub use program::{Op, QuestionProgram, WORDS, apply, nearest, operand_count};
pub use read_back::read_back;
pub use schema::{gbnf_grammar, json_schema};
