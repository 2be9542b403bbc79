//! Reads the text of formulas into steps in postfix order (precedence climbing, Pratt 1973).

use super::error::{DEEPEST, SyntaxError, known_units};
use super::hint;
use super::parameter::FormulaParameter;
use super::program::{FUNCTIONS, FormulaProgram, Instruction, TARGETS, VARIABLES, has_runaway_constant};
use super::unit::is_unit;

pub(super) struct Parser<'a> {
    text: &'a str,
    /// Byte that comes next.
    at: usize,
    /// Given, then those that the text declares and that were not given.
    parameters: Vec<FormulaParameter>,
    declared: Vec<FormulaParameter>,
    /// Whether units must be known ones, and constants finite.
    strict: bool,
}

/// A byte position, and the error there.
pub(super) type Fault = (usize, SyntaxError);

impl<'a> Parser<'a> {
    pub fn new(text: &'a str, parameters: &'a [FormulaParameter], strict: bool) -> Self {
        Parser { text, at: 0, parameters: parameters.to_vec(), declared: vec![], strict }
    }

    /// The program, and the parameters that the text declares.
    pub fn program(mut self) -> Result<(FormulaProgram, Vec<FormulaParameter>), Fault> {
        let mut program = FormulaProgram::default();
        loop {
            while self.peek_line().is_some_and(|c| c == ';' || c == '\n') {
                self.at += 1;
            }
            if self.peek_line().is_none() && program != FormulaProgram::default() {
                return Ok((program, self.declared));
            }
            self.skip();
            let (at, name) = (self.at, self.word());
            if name == "let" {
                self.declaration()?;
                self.end()?;
                continue;
            }
            if self.at == self.text.len() && name.is_empty() {
                return Err(self.unexpected("a formula, such as ax = -0.1*vx"));
            }
            let target = TARGETS.iter().position(|t| *t == name).ok_or_else(|| {
                let (known, hint) = (TARGETS.join(" ") + " let", hint::left_side(name));
                (at, SyntaxError::Unknown { found: self.seen(at, name), wanted: "left side", hint, known })
            })?;
            if !program.steps[target].is_empty() {
                return Err((at, SyntaxError::Twice { name: TARGETS[target] }));
            }
            self.take('=', "'='")?;
            let mut steps = vec![];
            let start = self.at;
            self.expression(0, 0, &mut steps)?;
            if self.strict && has_runaway_constant(&steps, TARGETS[target].starts_with('a')) {
                return Err((start, SyntaxError::RunawayConstant { name: TARGETS[target] }));
            }
            program.steps[target] = steps;
            self.end()?;
        }
    }

    fn end(&mut self) -> Result<(), Fault> {
        match self.peek_line() {
            None | Some(';' | '\n') => Ok(()),
            _ => Err(self.unexpected("an operator, ';' or the end")),
        }
    }

    /// `k [1/m] = 0.1 from 0 to 5`, what follows the name being optional.
    fn declaration(&mut self) -> Result<(), Fault> {
        self.peek_line();
        let (at, name) = (self.at, self.word().to_string());
        if name.is_empty() {
            return Err(self.unexpected("a name"));
        }
        let mut unit = "1".to_string();
        if self.peek_line() == Some('[') {
            self.at += 1;
            let rest = &self.text[self.at..];
            let end = rest.find([']', '\n', ';']).filter(|end| rest[*end..].starts_with(']'));
            let Some(end) = end else {
                let found = "the end".into();
                return Err((self.at, SyntaxError::Unexpected { wanted: "']'", found, hint: "" }));
            };
            let given = &rest[..end];
            if !given.trim().is_empty() {
                unit = given.trim().to_string();
            }
            if self.strict && !is_unit(&unit) {
                let at = self.at + given.len() - given.trim_start().len();
                let (wanted, hint, known) = ("unit", String::new(), known_units());
                return Err((at, SyntaxError::Unknown { found: unit, wanted, hint, known }));
            }
            self.at += end + 1;
        }
        let mut start = None;
        if self.peek_line() == Some('=') {
            self.at += 1;
            start = Some(self.signed()?);
        }
        let (mut min, mut max) = (None, None);
        if self.keyword("from") {
            min = Some(self.signed()?);
            if !self.keyword("to") {
                return Err(self.unexpected("'to'"));
            }
            max = Some(self.signed()?);
        }
        let parameter = FormulaParameter::new(name, unit, start, min, max);
        if let Some(problem) = parameter.problem(&self.declared) {
            return Err((at, SyntaxError::Parameter { name: parameter.name, problem }));
        }
        if self.parameters.iter().all(|p| p.name != parameter.name) {
            self.parameters.push(parameter.clone());
        }
        self.declared.push(parameter);
        Ok(())
    }

    fn keyword(&mut self, wanted: &str) -> bool {
        self.peek_line();
        let at = self.at;
        let found = self.word() == wanted;
        if !found {
            self.at = at;
        }
        found
    }

    fn signed(&mut self) -> Result<f64, Fault> {
        let minus = self.peek_line() == Some('-');
        self.at += usize::from(minus);
        self.peek_line();
        let value = self.number()?;
        Ok(if minus { -value } else { value })
    }

    /// Operators that bind at least as strongly as `least`.
    fn expression(&mut self, least: u8, depth: usize, out: &mut Vec<Instruction>) -> Result<(), Fault> {
        if depth > DEEPEST {
            return Err((self.at, SyntaxError::TooDeep));
        }
        self.skip();
        match self.peek() {
            Some('-') => {
                self.at += 1;
                self.expression(5, depth + 1, out)?;
                out.push(Instruction::Negate);
            }
            Some('+') => {
                self.at += 1;
                self.expression(5, depth + 1, out)?;
            }
            Some('(') => {
                self.at += 1;
                self.expression(0, depth + 1, out)?;
                self.take(')', "')'")?;
            }
            Some(c) if c.is_ascii_digit() || c == '.' => out.push(Instruction::Number(self.number()?)),
            Some(c) if c.is_ascii_alphabetic() => self.named(depth, out)?,
            _ => return Err(self.unexpected("a number, a name or '('")),
        }
        loop {
            // A formula ends with its line.
            let (left, right, step) = match self.peek_line() {
                Some('+') => (1, 2, Instruction::Add),
                Some('-') => (1, 2, Instruction::Subtract),
                Some('*') => (3, 4, Instruction::Multiply),
                Some('/') => (3, 4, Instruction::Divide),
                Some('^') => (8, 7, Instruction::Power),
                _ => return Ok(()),
            };
            if left < least {
                return Ok(());
            }
            self.at += 1;
            // -x^2 is -(x^2), and 2^-x is 2^(-x).
            self.expression(right, depth + 1, out)?;
            out.push(step);
        }
    }

    fn named(&mut self, depth: usize, out: &mut Vec<Instruction>) -> Result<(), Fault> {
        let (at, name) = (self.at, self.word());
        if let Some(i) = self.parameters.iter().position(|p| p.name == name) {
            out.push(Instruction::Parameter(i));
        } else if let Some(i) = VARIABLES.iter().position(|v| *v == name) {
            out.push(Instruction::Variable(i));
        } else if name == "pi" {
            out.push(Instruction::Number(std::f64::consts::PI));
        } else if let Some(i) = FUNCTIONS.iter().position(|f| f.0 == name) {
            self.take('(', "'('")?;
            let mut found = 0;
            loop {
                self.expression(0, depth + 1, out)?;
                found += 1;
                self.skip();
                if self.peek() != Some(',') {
                    break;
                }
                self.at += 1;
            }
            self.take(')', "')' or ','")?;
            let (name, wanted, step) = FUNCTIONS[i];
            if found != wanted {
                return Err((at, SyntaxError::Arguments { name, wanted, found }));
            }
            out.push(step);
        } else {
            let own = self.parameters.iter().map(|p| p.name.as_str());
            let all = own.chain(VARIABLES).chain(["pi"]).chain(FUNCTIONS.map(|f| f.0));
            let (hint, known) = (hint::name(name, all.clone()), all.collect::<Vec<_>>().join(" "));
            return Err((at, SyntaxError::Unknown { found: name.into(), wanted: "name here", hint, known }));
        }
        Ok(())
    }

    fn number(&mut self) -> Result<f64, Fault> {
        let rest = &self.text[self.at..];
        let digits = |s: &str| s.bytes().take_while(|b| b.is_ascii_digit() || *b == b'.').count();
        let mut end = digits(rest);
        if let Some(exponent) = rest[end..].strip_prefix(['e', 'E']) {
            let sign = usize::from(exponent.starts_with(['+', '-']));
            let power = exponent[sign..].bytes().take_while(u8::is_ascii_digit).count();
            end += if power > 0 { 1 + sign + power } else { 0 };
        }
        let value = rest[..end].parse().ok().filter(|v: &f64| v.is_finite());
        let value = value.ok_or_else(|| self.unexpected("a number"))?;
        self.at += end;
        Ok(value)
    }

    fn word(&mut self) -> &'a str {
        let rest = &self.text[self.at..];
        let end = rest.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
        self.at += end;
        &rest[..end]
    }

    fn take(&mut self, c: char, wanted: &'static str) -> Result<(), Fault> {
        self.skip();
        if self.peek() != Some(c) {
            return Err(self.unexpected(wanted));
        }
        self.at += c.len_utf8();
        Ok(())
    }

    fn unexpected(&self, wanted: &'static str) -> Fault {
        let hint = hint::sign(wanted, &self.text[self.at..]);
        (self.at, SyntaxError::Unexpected { wanted, found: self.seen(self.at, ""), hint })
    }

    /// The word, or the characters in its place.
    fn seen(&self, at: usize, word: &str) -> String {
        match self.text.get(at..).and_then(|rest| rest.chars().next()) {
            _ if !word.is_empty() => word.into(),
            Some('\n') => "the end of the line".into(),
            Some(c) => format!("{c:?}"),
            None => "the end".into(),
        }
    }

    fn peek(&self) -> Option<char> {
        self.text[self.at..].chars().next()
    }

    /// What comes next after blanks and a comment, ends of lines being no blanks.
    fn peek_line(&mut self) -> Option<char> {
        self.at += self.text[self.at..].bytes().take_while(|b| matches!(b, b' ' | b'\t' | b'\r')).count();
        if self.peek() == Some('#') {
            let rest = &self.text[self.at..];
            self.at += rest.find('\n').unwrap_or(rest.len());
        }
        self.peek()
    }

    fn skip(&mut self) {
        while self.peek_line() == Some('\n') {
            self.at += 1;
        }
    }
}
