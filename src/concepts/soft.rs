//! Programs with uncertain words: one soft function for each operation of `reason`, on a tape.
//!
//! A set holds each member with a probability, and members are independent; any other value is a distribution over exact values.
//!
//! | operation | soft function |
//! |---|---|
//! | filter by a word | `p_o P(word|o)` |
//! | filter by objects | `p_e (1 - prod_o (1 - p_o))` over the participants o; of one object `p_e sum_o p_o` |
//! | filter by a moment | `p_e sum_m P(m) [e before m]` |
//! | unique | `P(o) ~ p_o prod_{o' != o} (1 - p_o')` |
//! | exist, count | `1 - prod (1 - p)`; the Poisson binomial distribution |
//! | first, second, last | P(k earlier ones, and this one) |
//! | belong to | `sum_e P(e) min(1, sum of p over events like e)`; of an object `1 - prod (1 - p_e)` over its events |
//! | query | `P(word) = sum_o P(o) P(word|o)` |
//! | counterfact | events of each change, with its probability |
//! | every other | the exact operation on each combination of exact operands, with the product of their probabilities |
//!
//! Combinations for which the exact operation has no result (no such object, no such event) are left out, and the rest is
//! normalised: the question presupposes that it has an answer. The probability of that is reported.
//! On probabilities 0 and 1 every function equals the exact operation.

use super::soft_value::{SoftValue, add_choice, any, counts, none_of, normalised, only_one};
use super::tape::{LEAST, ONE, Tape, Variable, ZERO};
use crate::reason::{
    Halt, Op, ProgramValue, QuestionProgram, ReasonError, RolloutContext, SceneEvent, SceneEventKind,
    WordFamily, operand_count, ops, step,
};

/// The words of one family for the objects of a scene.
#[derive(Debug, Clone)]
pub struct SoftFamily<'a> {
    pub family: WordFamily,
    pub words: &'a [String],
    /// `[object][word]`.
    pub probabilities: Vec<Vec<Variable>>,
}

/// What a soft program runs against.
pub struct SoftContext<'a> {
    /// Events, motion and simulations; its words are not used.
    pub exact: RolloutContext<'a>,
    pub families: &'a [SoftFamily<'a>],
    /// Word k of `Op::Concept(k)`.
    pub vocabulary: &'a [String],
}

/// A run on a tape.
pub struct SoftRun<'a> {
    pub context: &'a SoftContext<'a>,
    pub tape: &'a mut Tape,
    pub stack: Vec<SoftValue>,
    /// Probability that every presupposition so far holds.
    pub presupposed: Variable,
}

type SoftChoices = Vec<(ProgramValue, Variable)>;

impl SoftRun<'_> {
    /// Runs a checked program on the stack.
    pub fn run(&mut self, program: &QuestionProgram) -> Result<(), Halt> {
        for op in &program.ops {
            let value = self.step(*op)?;
            self.stack.push(value);
        }
        Ok(())
    }

    fn step(&mut self, op: Op) -> Result<SoftValue, Halt> {
        Ok(match op {
            Op::FilterColor | Op::FilterMaterial | Op::FilterShape => self.filter_word(op)?,
            Op::FilterMoving | Op::FilterStationary => self.filter_motion(op)?,
            Op::FilterIn | Op::FilterOut | Op::FilterCollision | Op::FilterSide => self.filter_kind(op)?,
            Op::FilterPartner => self.filter_partner()?,
            Op::FilterBefore | Op::FilterAfter => self.filter_time(op)?,
            Op::FilterStart | Op::FilterEnd => {
                self.stack.pop();
                self.exact(if op == Op::FilterStart { Op::Start } else { Op::End }, vec![])?
            }
            Op::FilterOrder => self.filter_order()?,
            Op::FilterAncestor => self.filter_ancestor()?,
            Op::Unique => self.unique()?,
            Op::Count | Op::Exist => self.count(op)?,
            Op::BelongTo => self.belong_to()?,
            Op::QueryColor | Op::QueryMaterial | Op::QueryShape => self.query(op)?,
            Op::Counterfact => self.counterfact()?,
            Op::AddAnother => self.add_another()?,
            Op::FilterConcept | Op::Apply => return Err(self.mismatch(op)),
            _ => self.enumerated(op)?,
        })
    }

    fn mismatch(&self, op: Op) -> Halt {
        let found = format!("{op:?}, which has no soft function for these operands");
        Halt::Error(ReasonError::ProgramResult { expected: "a question about words of families", found })
    }

    fn objects(&self) -> usize {
        self.context.exact.scene.objects.len()
    }

    fn exact(&self, op: Op, mut stack: Vec<ProgramValue>) -> Result<SoftValue, Halt> {
        let value = step(op, self.context.exact, &mut stack, &[])?;
        Ok(SoftValue::certain(value, self.objects()))
    }

    fn choices(&mut self, op: Op) -> Result<SoftChoices, Halt> {
        match self.stack.pop() {
            Some(SoftValue::Choice(choices)) => Ok(choices),
            _ => Err(self.mismatch(op)),
        }
    }

    fn events(&mut self, op: Op) -> Result<Vec<(SceneEvent, Variable)>, Halt> {
        match self.stack.pop() {
            Some(SoftValue::Events(events)) => Ok(events),
            _ => Err(self.mismatch(op)),
        }
    }

    fn set(&mut self, op: Op) -> Result<Vec<Variable>, Halt> {
        match self.stack.pop() {
            Some(SoftValue::Objects(members)) => Ok(members),
            _ => Err(self.mismatch(op)),
        }
    }

    /// A distribution given that it has a value.
    fn given(&mut self, choices: SoftChoices) -> SoftValue {
        let (choices, sum) = normalised(self.tape, choices);
        self.presupposed = self.tape.mul(self.presupposed, sum);
        SoftValue::Choice(choices)
    }

    /// The exact operation on each combination of exact operands.
    fn enumerated(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let mut combinations: Vec<(Vec<ProgramValue>, Variable)> = vec![(vec![], ONE)];
        for _ in 0..operand_count(op) {
            let operand = self.choices(op)?;
            let mut next = vec![];
            for (values, p) in combinations {
                for (value, q) in &operand {
                    let both = self.tape.mul(p, *q);
                    // The stack has the first operand on top.
                    next.push(([vec![value.clone()], values.clone()].concat(), both));
                }
            }
            combinations = next;
        }
        if let [(values, ONE)] = &combinations[..] {
            return self.exact(op, values.clone());
        }
        let mut results = vec![];
        for (values, p) in combinations {
            match step(op, self.context.exact, &mut values.clone(), &[]) {
                Ok(value) => {
                    let weight = match op {
                        Op::GetPartner => self.partner_weight(&values, p),
                        _ => p,
                    };
                    add_choice(self.tape, &mut results, value, weight);
                }
                Err(Halt::Error(ReasonError::NoSingleEvent { .. } | ReasonError::NoSuchObject { .. })) => {}
                Err(other) => return Err(other),
            }
        }
        Ok(self.given(results))
    }

    /// An object and a collision that it takes no part in are one only in programs that contradict themselves.
    fn partner_weight(&mut self, values: &[ProgramValue], p: Variable) -> Variable {
        match values {
            [ProgramValue::Event(event), ProgramValue::Object(object)] if !event.objects.contains(object) => {
                self.tape.scale(p, LEAST)
            }
            _ => p,
        }
    }

    /// The probability of a word for an object.
    fn word(&self, family: WordFamily, object: usize, word: &str) -> Variable {
        let Some(known) = self.context.families.iter().find(|f| f.family == family) else { return ZERO };
        let at = known.words.iter().position(|w| w == word);
        at.and_then(|k| known.probabilities.get(object)?.get(k)).copied().unwrap_or(ZERO)
    }

    fn filter_word(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let word = match &self.choices(op)?[..] {
            [(ProgramValue::Word(word), _)] => word.to_string(),
            [(ProgramValue::Concept(k), _)] => self.context.vocabulary.get(*k).cloned().unwrap_or_default(),
            _ => return Err(self.mismatch(op)),
        };
        let mut members = self.set(op)?;
        for (object, p) in members.iter_mut().enumerate() {
            let of_word = self.word(family(op), object, &word);
            *p = self.tape.mul(*p, of_word);
        }
        Ok(SoftValue::Objects(members))
    }

    fn query(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let objects = self.choices(op)?;
        let families = self.context.families;
        let Some(known) = families.iter().find(|f| f.family == family(op)) else {
            return Err(self.mismatch(op));
        };
        let mut answers = vec![];
        for word in known.words {
            let mut terms = vec![];
            for (value, p) in &objects {
                if let ProgramValue::Object(o) = value {
                    let of_word = self.word(family(op), *o, word);
                    terms.push(self.tape.mul(*p, of_word));
                }
            }
            let p = self.tape.sum(&terms);
            add_choice(self.tape, &mut answers, ProgramValue::Text(word.clone()), p);
        }
        Ok(SoftValue::Choice(answers))
    }

    fn filter_motion(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let moments = self.choices(op)?;
        let mut members = self.set(op)?;
        let rollout = self.context.exact.rollout(&[])?;
        let all: Vec<usize> = (0..members.len()).collect();
        let mut sums = vec![ZERO; members.len()];
        for (moment, p) in moments {
            let frame = match moment {
                ProgramValue::Frame(frame) => frame,
                ProgramValue::Event(event) => Some(event.frame),
                _ => return Err(self.mismatch(op)),
            };
            for o in ops::filter_motion(rollout, &all, frame, op == Op::FilterMoving) {
                sums[o] = self.tape.add(sums[o], p);
            }
        }
        for (m, s) in members.iter_mut().zip(sums) {
            *m = self.tape.mul(*m, s);
        }
        Ok(SoftValue::Objects(members))
    }

    /// P(an event has a participant among the objects), of a set of objects or of one object.
    fn participates(&mut self, event: &SceneEvent, objects: &SoftValue) -> Variable {
        match objects {
            SoftValue::Objects(members) => {
                let own: Vec<Variable> =
                    event.objects.iter().filter_map(|o| members.get(*o)).copied().collect();
                any(self.tape, &own)
            }
            SoftValue::Choice(choices) => {
                let own = choices.iter().filter(|(value, _)| match value {
                    ProgramValue::Object(o) => event.objects.contains(o),
                    _ => false,
                });
                let own: Vec<Variable> = own.map(|c| c.1).collect();
                self.tape.sum(&own)
            }
            SoftValue::Events(_) => ZERO,
        }
    }

    fn filter_kind(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let kind = match op {
            Op::FilterIn => SceneEventKind::In,
            Op::FilterOut => SceneEventKind::Out,
            Op::FilterSide => match &self.choices(op)?[..] {
                [(ProgramValue::Word(side), _)] => SceneEventKind::Side(side),
                _ => return Err(self.mismatch(op)),
            },
            _ => SceneEventKind::Collision,
        };
        let Some(objects) = self.stack.pop() else { return Err(self.mismatch(op)) };
        let mut events = self.events(op)?;
        events.retain(|(e, _)| e.kind == kind);
        for (event, p) in &mut events {
            let takes_part = self.participates(event, &objects);
            *p = self.tape.mul(*p, takes_part);
        }
        events.retain(|(_, p)| *p != ZERO);
        Ok(SoftValue::Events(events))
    }

    fn filter_partner(&mut self) -> Result<SoftValue, Halt> {
        let partners = self.set(Op::FilterPartner)?;
        let objects = self.choices(Op::FilterPartner)?;
        let mut events = self.events(Op::FilterPartner)?;
        events.retain(|(e, _)| e.kind == SceneEventKind::Collision);
        for (event, p) in &mut events {
            let mut terms = vec![];
            for (value, q) in &objects {
                let ProgramValue::Object(object) = value else { continue };
                if event.objects.contains(object) {
                    let others = event.objects.iter().filter(|o| *o != object);
                    let others: Vec<Variable> = others.filter_map(|o| partners.get(*o)).copied().collect();
                    let met = any(self.tape, &others);
                    terms.push(self.tape.mul(*q, met));
                }
            }
            let holds = self.tape.sum(&terms);
            *p = self.tape.mul(*p, holds);
        }
        events.retain(|(_, p)| *p != ZERO);
        Ok(SoftValue::Events(events))
    }

    /// The moments of a distribution over events and frames that have a time.
    fn moments(&mut self, op: Op) -> Result<Vec<(Option<usize>, Variable)>, Halt> {
        let moments = self.choices(op)?;
        let timed = moments.into_iter().filter(|(value, _)| match value {
            ProgramValue::Event(event) => event.kind != SceneEventKind::Never,
            _ => true,
        });
        let (timed, sum) = normalised(self.tape, timed.collect());
        if timed.is_empty() {
            return Err(Halt::Error(ReasonError::NoSingleEvent { found: "none".into() }));
        }
        self.presupposed = self.tape.mul(self.presupposed, sum);
        let frame = |value: &ProgramValue| match value {
            ProgramValue::Event(event) => Some(event.frame),
            ProgramValue::Frame(frame) => *frame,
            _ => None,
        };
        Ok(timed.iter().map(|(value, p)| (frame(value), *p)).collect())
    }

    fn filter_time(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let moments = self.moments(op)?;
        let mut events = self.events(op)?;
        for (event, p) in &mut events {
            let fits = |frame: Option<usize>| {
                frame.is_none_or(|f| if op == Op::FilterAfter { event.frame > f } else { event.frame < f })
            };
            let fitting: Vec<Variable> = moments.iter().filter(|m| fits(m.0)).map(|m| m.1).collect();
            let inside = if fitting.len() == moments.len() { ONE } else { self.tape.sum(&fitting) };
            *p = self.tape.mul(*p, inside);
        }
        events.retain(|(_, p)| *p != ZERO);
        Ok(SoftValue::Events(events))
    }

    fn filter_order(&mut self) -> Result<SoftValue, Halt> {
        let place = match &self.choices(Op::FilterOrder)?[..] {
            [(ProgramValue::Order(place), _)] => *place,
            _ => return Err(self.mismatch(Op::FilterOrder)),
        };
        let mut events = self.events(Op::FilterOrder)?;
        events.sort_by_key(|(e, _)| e.frame);
        let members: Vec<Variable> = events.iter().map(|e| e.1).collect();
        let mut choices = vec![];
        for (k, (event, p)) in events.iter().enumerate() {
            let rank = if place == usize::MAX {
                none_of(self.tape, &members[k + 1..])
            } else {
                counts(self.tape, &members[..k]).get(place).copied().unwrap_or(ZERO)
            };
            let chosen = self.tape.mul(*p, rank);
            add_choice(self.tape, &mut choices, ProgramValue::Event(event.clone()), chosen);
        }
        if choices.is_empty() {
            return Err(Halt::Error(ReasonError::NoSingleEvent { found: "none".into() }));
        }
        Ok(self.given(choices))
    }

    /// Whether an event is in the set on the way to a cause is decided by its more probable value.
    fn filter_ancestor(&mut self) -> Result<SoftValue, Halt> {
        let of = self.choices(Op::FilterAncestor)?;
        let events = self.events(Op::FilterAncestor)?;
        let happened =
            |v: &ProgramValue| matches!(v, ProgramValue::Event(e) if e.kind != SceneEventKind::Never);
        let of: SoftChoices = of.into_iter().filter(|(v, _)| happened(v)).collect();
        if of.is_empty() {
            return Err(Halt::Error(ReasonError::NoSingleEvent { found: "none".into() }));
        }
        let (of, sum) = normalised(self.tape, of);
        self.presupposed = self.tape.mul(self.presupposed, sum);
        let likely = events.iter().filter(|(_, p)| self.tape.value(*p) > 0.5);
        let likely: Vec<SceneEvent> = likely.map(|(e, _)| e.clone()).collect();
        let mut sums = vec![ZERO; events.len()];
        for (value, p) in &of {
            let ProgramValue::Event(event) = value else { continue };
            let causes = ops::ancestors(&likely, event);
            for (sum, (candidate, _)) in sums.iter_mut().zip(&events) {
                if causes.contains(candidate) {
                    *sum = self.tape.add(*sum, *p);
                }
            }
        }
        let mut causes = vec![];
        for ((event, p), sum) in events.into_iter().zip(sums) {
            let both = self.tape.mul(p, sum);
            if both != ZERO {
                causes.push((event, both));
            }
        }
        causes.sort_by_key(|(e, _)| e.frame);
        Ok(SoftValue::Events(causes))
    }

    fn unique(&mut self) -> Result<SoftValue, Halt> {
        let mut choices = vec![];
        match self.stack.pop() {
            Some(SoftValue::Objects(members)) => {
                for (object, p) in only_one(self.tape, &members).into_iter().enumerate() {
                    add_choice(self.tape, &mut choices, ProgramValue::Object(object), p);
                }
                if choices.is_empty() {
                    let phrase = "an object of the question".to_string();
                    return Err(Halt::Error(ReasonError::NoSuchObject { phrase, candidates: vec![] }));
                }
            }
            Some(SoftValue::Events(events)) => {
                // Of several alike the first one stands for all.
                let mut kinds: Vec<(SceneEvent, Vec<Variable>)> = vec![];
                for (event, p) in events {
                    match kinds.iter_mut().find(|(known, _)| known.is_like(&event)) {
                        Some((_, members)) => members.push(p),
                        None => kinds.push((event, vec![p])),
                    }
                }
                let members: Vec<Variable> = kinds.iter().map(|(_, m)| any(self.tape, m)).collect();
                for (k, p) in only_one(self.tape, &members).into_iter().enumerate() {
                    add_choice(self.tape, &mut choices, ProgramValue::Event(kinds[k].0.clone()), p);
                }
                let none = none_of(self.tape, &members);
                let never = SceneEvent { kind: SceneEventKind::Never, frame: 0, objects: vec![] };
                add_choice(self.tape, &mut choices, ProgramValue::Event(never), none);
            }
            _ => return Err(self.mismatch(Op::Unique)),
        }
        Ok(self.given(choices))
    }

    fn count(&mut self, op: Op) -> Result<SoftValue, Halt> {
        let members = match self.stack.pop() {
            Some(SoftValue::Objects(members)) => members,
            Some(SoftValue::Events(events)) => events.into_iter().map(|e| e.1).collect(),
            _ => return Err(self.mismatch(op)),
        };
        let mut choices = vec![];
        if op == Op::Count {
            for (k, p) in counts(self.tape, &members).into_iter().enumerate() {
                add_choice(self.tape, &mut choices, ProgramValue::Number(k), p);
            }
        } else {
            let some = any(self.tape, &members);
            choices = self.yes_or_no(some);
        }
        Ok(SoftValue::Choice(choices))
    }

    fn yes_or_no(&mut self, yes: Variable) -> SoftChoices {
        let no = self.tape.complement(yes);
        let mut choices = vec![];
        add_choice(self.tape, &mut choices, ProgramValue::Bool(true), yes);
        add_choice(self.tape, &mut choices, ProgramValue::Bool(false), no);
        choices
    }

    fn belong_to(&mut self) -> Result<SoftValue, Halt> {
        let events = self.events(Op::BelongTo)?;
        let mut terms = vec![];
        for (value, p) in self.choices(Op::BelongTo)? {
            let inside = match value {
                ProgramValue::Event(event) => {
                    let alike = events.iter().filter(|(e, _)| e.is_like(&event));
                    let alike: Vec<Variable> = alike.map(|e| e.1).collect();
                    let sum = self.tape.sum(&alike);
                    self.tape.min(ONE, sum)
                }
                ProgramValue::Object(object) => {
                    let own = events.iter().filter(|(e, _)| e.objects.contains(&object));
                    let own: Vec<Variable> = own.map(|e| e.1).collect();
                    any(self.tape, &own)
                }
                _ => return Err(self.mismatch(Op::BelongTo)),
            };
            terms.push(self.tape.mul(p, inside));
        }
        let yes = self.tape.sum(&terms);
        let choices = self.yes_or_no(yes);
        Ok(SoftValue::Choice(choices))
    }

    fn counterfact(&mut self) -> Result<SoftValue, Halt> {
        let changes = self.choices(Op::Counterfact)?;
        if matches!(self.stack.last(), Some(SoftValue::Events(_))) {
            self.stack.pop();
        }
        let mut events: Vec<(SceneEvent, Variable)> = vec![];
        for (change, p) in changes {
            // An unlikely object's counterfactual would only cost its simulation.
            if self.tape.value(p) < LEAST_CHANGE {
                continue;
            }
            let mut stack = vec![change];
            let ProgramValue::Events(under) = step(Op::Counterfact, self.context.exact, &mut stack, &[])?
            else {
                return Err(self.mismatch(Op::Counterfact));
            };
            for event in under {
                match events.iter_mut().find(|(known, _)| *known == event) {
                    Some((_, sum)) => *sum = self.tape.add(*sum, p),
                    None => events.push((event, p)),
                }
            }
        }
        events.sort_by_key(|(e, _)| e.frame);
        Ok(SoftValue::Events(events))
    }

    /// The kind of the added object is that of the most probable one of the set.
    fn add_another(&mut self) -> Result<SoftValue, Halt> {
        let at = self.stack.len().checked_sub(operand_count(Op::AddAnother));
        let Some(at) = at else { return Err(self.mismatch(Op::AddAnother)) };
        let SoftValue::Objects(members) = self.stack.remove(at) else {
            return Err(self.mismatch(Op::AddAnother));
        };
        let likely = members.iter().enumerate().rev();
        let most = likely.max_by(|a, b| self.tape.value(*a.1).total_cmp(&self.tape.value(*b.1)));
        let alike: Vec<usize> = most.map(|(k, _)| k).into_iter().collect();
        let (direction, length, beside) =
            (self.choices(Op::Shift)?, self.choices(Op::Shift)?, self.choices(Op::Shift)?);
        let [(way, _), (far, _)] = [direction.first(), length.first()]
            .map(|c| c.cloned().unwrap_or((ProgramValue::Bool(false), ZERO)));
        let mut results = vec![];
        for (object, p) in beside {
            let mut stack = vec![ProgramValue::Objects(alike.clone()), object, far.clone(), way.clone()];
            let value = step(Op::AddAnother, self.context.exact, &mut stack, &[])?;
            add_choice(self.tape, &mut results, value, p);
        }
        Ok(self.given(results))
    }
}

/// Least probability of an object whose counterfactual is simulated.
const LEAST_CHANGE: f64 = 1e-3;

/// The family that an operation filters by or asks for.
fn family(op: Op) -> WordFamily {
    match op {
        Op::FilterColor | Op::QueryColor => WordFamily::Color,
        Op::FilterMaterial | Op::QueryMaterial => WordFamily::Material,
        _ => WordFamily::Shape,
    }
}
