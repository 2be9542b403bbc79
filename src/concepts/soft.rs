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
use super::tape::{ONE, Tape, Variable, ZERO};
use crate::reason::{
    Gives, Halt, Op, Operation, ProgramValue, QuestionProgram, ReasonError, RolloutContext, SceneEvent,
    SceneEventKind, SpanKind, WordFamily, operand_count, ops, step,
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
/// An operation of a program.
type Called = &'static Operation;

/// Which events a filter keeps.
enum KindFilter {
    Kind(SceneEventKind),
    /// Hits of any side of the table.
    Sides,
    /// These and collisions.
    Contacts,
}

impl KindFilter {
    fn keeps(&self, kind: SceneEventKind) -> bool {
        match self {
            KindFilter::Kind(one) => kind == *one,
            KindFilter::Sides => matches!(kind, SceneEventKind::Side(_)),
            KindFilter::Contacts => matches!(kind, SceneEventKind::Side(_) | SceneEventKind::Collision),
        }
    }
}

impl SoftRun<'_> {
    /// Runs a checked program on the stack.
    pub fn run(&mut self, program: &QuestionProgram) -> Result<(), Halt> {
        for op in &program.ops {
            let value = match op {
                Op::Push(_, value) => SoftValue::certain(value.clone(), self.objects()),
                Op::Call(operation) => self.call(operation)?,
            };
            self.stack.push(value);
        }
        Ok(())
    }

    fn call(&mut self, op: Called) -> Result<SoftValue, Halt> {
        match op.token {
            "filter_color" | "filter_material" | "filter_shape" => self.filter_word(op),
            "filter_moving" | "filter_stationary" => self.filter_motion(op),
            "filter_in" | "filter_out" | "filter_stop" | "filter_collision" | "filter_approach"
            | "filter_side" | "filter_sides" | "filter_contact" => self.filter_kind(op),
            "filter_partner" => self.filter_partner(op),
            "filter_before" | "filter_after" => self.filter_time(op),
            "filter_start" | "filter_end" => self.exact_edge(op),
            "filter_order" => self.filter_order(op),
            "filter_ancestor" => self.filter_ancestor(op),
            "unique" => self.unique(op),
            "count" | "exist" => self.count(op),
            "belong_to" => self.belong_to(op),
            "query_color" | "query_material" | "query_shape" => self.query(op),
            "filter_counterfact" => self.counterfact(op),
            "add_another" => self.add_another(op),
            "filter_concept" | "apply" => Err(self.mismatch(op)),
            // What is supposed for all that follows has no distribution here.
            _ if op.gives == Gives::Nothing => Err(self.mismatch(op)),
            _ => self.enumerated(op),
        }
    }

    fn mismatch(&self, op: Called) -> Halt {
        let found = format!("{op:?}, which has no soft function for these operands");
        Halt::Error(ReasonError::ProgramResult { expected: "a question about words of families", found })
    }

    fn objects(&self) -> usize {
        self.context.exact.scene.objects.len()
    }

    /// The exact operation.
    fn value(&self, op: Called, mut stack: Vec<ProgramValue>) -> Result<ProgramValue, Halt> {
        step(&Op::Call(op), self.context.exact, &mut stack)
    }

    /// The start or the end of the video, whatever the events.
    fn exact_edge(&mut self, op: Called) -> Result<SoftValue, Halt> {
        self.stack.pop();
        let value = self.value(op, vec![ProgramValue::Events(vec![])])?;
        Ok(SoftValue::certain(value, self.objects()))
    }

    fn choices(&mut self, op: Called) -> Result<SoftChoices, Halt> {
        match self.stack.pop() {
            Some(SoftValue::Choice(choices)) => Ok(choices),
            _ => Err(self.mismatch(op)),
        }
    }

    fn events(&mut self, op: Called) -> Result<Vec<(SceneEvent, Variable)>, Halt> {
        match self.stack.pop() {
            Some(SoftValue::Events(events)) => Ok(events),
            _ => Err(self.mismatch(op)),
        }
    }

    fn set(&mut self, op: Called) -> Result<Vec<Variable>, Halt> {
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

    /// Each combination of this number of exact operands, with the first one on top, and the product of their probabilities.
    fn combinations(
        &mut self,
        op: Called,
        operands: usize,
    ) -> Result<Vec<(Vec<ProgramValue>, Variable)>, Halt> {
        let mut combinations: Vec<(Vec<ProgramValue>, Variable)> = vec![(vec![], ONE)];
        for _ in 0..operands {
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
        Ok(combinations)
    }

    /// The exact operation on each combination of exact operands.
    fn enumerated(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let combinations = self.combinations(op, operand_count(&Op::Call(op)))?;
        if let [(values, ONE)] = &combinations[..] {
            let value = self.value(op, values.clone())?;
            return Ok(SoftValue::certain(value, self.objects()));
        }
        let mut results = vec![];
        for (values, p) in combinations {
            match self.value(op, values) {
                Ok(value) => add_choice(self.tape, &mut results, value, p),
                Err(Halt::Error(ReasonError::NoSingleEvent { .. } | ReasonError::NoSuchObject { .. })) => {}
                Err(other) => return Err(other),
            }
        }
        Ok(self.given(results))
    }

    /// The probability of a word for an object.
    fn word(&self, family: WordFamily, object: usize, word: &str) -> Variable {
        let Some(known) = self.context.families.iter().find(|f| f.family == family) else { return ZERO };
        let at = known.words.iter().position(|w| w == word);
        at.and_then(|k| known.probabilities.get(object)?.get(k)).copied().unwrap_or(ZERO)
    }

    fn filter_word(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let word = match &self.choices(op)?[..] {
            [(ProgramValue::Word(word), _)] => word.clone(),
            _ => return Err(self.mismatch(op)),
        };
        let mut members = self.set(op)?;
        for (object, p) in members.iter_mut().enumerate() {
            let of_word = self.word(WordFamily::of_operation(op.token), object, &word);
            *p = self.tape.mul(*p, of_word);
        }
        Ok(SoftValue::Objects(members))
    }

    fn query(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let objects = self.choices(op)?;
        let families = self.context.families;
        let Some(known) = families.iter().find(|f| f.family == WordFamily::of_operation(op.token)) else {
            return Err(self.mismatch(op));
        };
        let mut answers = vec![];
        for word in known.words {
            let mut terms = vec![];
            for (value, p) in &objects {
                if let ProgramValue::Object(o) = value {
                    let of_word = self.word(WordFamily::of_operation(op.token), *o, word);
                    terms.push(self.tape.mul(*p, of_word));
                }
            }
            let p = self.tape.sum(&terms);
            add_choice(self.tape, &mut answers, ProgramValue::Text(word.clone()), p);
        }
        Ok(SoftValue::Choice(answers))
    }

    fn filter_motion(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let moments = self.choices(op)?;
        let mut members = self.set(op)?;
        let exact = self.context.exact;
        let rollout = exact.rollout(&[], exact.frames(SpanKind::Video))?;
        let all: Vec<usize> = (0..members.len()).collect();
        let mut sums = vec![ZERO; members.len()];
        for (moment, p) in moments {
            let frame = match moment {
                ProgramValue::Frame(frame) => frame,
                ProgramValue::Event(event) => Some(event.frame),
                ProgramValue::Time(time) => Some(exact.scene.frame_at(time)),
                ProgramValue::Factor(frame) => Some(frame as usize),
                _ => return Err(self.mismatch(op)),
            };
            for o in ops::filter_motion(rollout, &all, frame, op.token == "filter_moving") {
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

    /// Which events a filter of a kind keeps.
    fn kind(&mut self, op: Called) -> Result<KindFilter, Halt> {
        if let Some(kind) = SceneEventKind::of_filter(op.token) {
            return Ok(KindFilter::Kind(kind));
        }
        Ok(match op.token {
            "filter_sides" => KindFilter::Sides,
            "filter_contact" => KindFilter::Contacts,
            _ => match &self.choices(op)?[..] {
                [(ProgramValue::Word(word), _)] => KindFilter::Kind(SceneEventKind::of_side(word)),
                _ => return Err(self.mismatch(op)),
            },
        })
    }

    fn filter_kind(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let kind = self.kind(op)?;
        let Some(objects) = self.stack.pop() else { return Err(self.mismatch(op)) };
        let mut events = self.events(op)?;
        events.retain(|(e, _)| kind.keeps(e.kind));
        for (event, p) in &mut events {
            let takes_part = self.participates(event, &objects);
            *p = self.tape.mul(*p, takes_part);
        }
        events.retain(|(_, p)| *p != ZERO);
        Ok(SoftValue::Events(events))
    }

    fn filter_partner(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let partners = self.set(op)?;
        let objects = self.choices(op)?;
        let mut events = self.events(op)?;
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

    /// The limits in time of a distribution over moments that have a time.
    fn limits(&mut self, op: Called) -> Result<Vec<(Option<SceneEvent>, Variable)>, Halt> {
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
        let scene = self.context.exact.scene;
        Ok(timed.iter().map(|(value, p)| (ops::limit(scene, value), *p)).collect())
    }

    fn filter_time(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let limits = self.limits(op)?;
        let mut events = self.events(op)?;
        for (event, p) in &mut events {
            let fits = |limit: &Option<SceneEvent>| {
                limit.as_ref().is_none_or(|limit| match op.token {
                    "filter_after" => limit.is_before(event),
                    _ => event.is_before(limit),
                })
            };
            let fitting: Vec<Variable> = limits.iter().filter(|l| fits(&l.0)).map(|l| l.1).collect();
            let inside = if fitting.len() == limits.len() { ONE } else { self.tape.sum(&fitting) };
            *p = self.tape.mul(*p, inside);
        }
        events.retain(|(_, p)| *p != ZERO);
        Ok(SoftValue::Events(events))
    }

    fn filter_order(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let place = match &self.choices(op)?[..] {
            [(ProgramValue::Order(place), _)] => *place,
            _ => return Err(self.mismatch(op)),
        };
        let mut events = self.events(op)?;
        events.sort_by(|a, b| a.0.time.total_cmp(&b.0.time));
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
    fn filter_ancestor(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let of = self.choices(op)?;
        let events = self.events(op)?;
        let happened =
            |v: &ProgramValue| matches!(v, ProgramValue::Event(e) if e.kind != SceneEventKind::Never);
        let of: SoftChoices = of.into_iter().filter(|(v, _)| happened(v)).collect();
        if of.is_empty() {
            return Err(Halt::Error(ReasonError::NoSingleEvent { found: "none".into() }));
        }
        let (of, sum) = normalised(self.tape, of);
        self.presupposed = self.tape.mul(self.presupposed, sum);
        let mut likely: Vec<SceneEvent> = vec![];
        for (event, p) in &events {
            if self.tape.is_above(*p, 0.5) {
                likely.push(event.clone());
            }
        }
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
        causes.sort_by(|a, b| a.0.time.total_cmp(&b.0.time));
        Ok(SoftValue::Events(causes))
    }

    fn unique(&mut self, op: Called) -> Result<SoftValue, Halt> {
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
                let never = SceneEvent { kind: SceneEventKind::Never, frame: 0, time: 0.0, objects: vec![] };
                add_choice(self.tape, &mut choices, ProgramValue::Event(never), none);
            }
            _ => return Err(self.mismatch(op)),
        }
        Ok(self.given(choices))
    }

    fn count(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let members = match self.stack.pop() {
            Some(SoftValue::Objects(members)) => members,
            Some(SoftValue::Events(events)) => events.into_iter().map(|e| e.1).collect(),
            _ => return Err(self.mismatch(op)),
        };
        let mut choices = vec![];
        if op.token == "count" {
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

    fn belong_to(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let events = self.events(op)?;
        let mut terms = vec![];
        for (value, p) in self.choices(op)? {
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
                _ => return Err(self.mismatch(op)),
            };
            terms.push(self.tape.mul(p, inside));
        }
        let yes = self.tape.sum(&terms);
        let choices = self.yes_or_no(yes);
        Ok(SoftValue::Choice(choices))
    }

    fn counterfact(&mut self, op: Called) -> Result<SoftValue, Halt> {
        // It takes all changes on top of the stack.
        let is_change = |value: &&SoftValue| {
            let first = if let SoftValue::Choice(choices) = value { choices.first() } else { None };
            matches!(first, Some((ProgramValue::Change(_), _)))
        };
        let below = self.stack.iter().rev().skip(1).take_while(is_change).count();
        let changes = self.combinations(op, 1 + below)?;
        if matches!(self.stack.last(), Some(SoftValue::Events(_))) {
            self.stack.pop();
        }
        let mut events: Vec<(SceneEvent, Variable)> = vec![];
        for (change, p) in changes {
            // An unlikely object's counterfactual would only cost its simulation.
            if !self.tape.is_above(p, LEAST_CHANGE) {
                continue;
            }
            let ProgramValue::Events(under) = self.value(op, change)? else {
                return Err(self.mismatch(op));
            };
            for event in under {
                match events.iter_mut().find(|(known, _)| *known == event) {
                    Some((_, sum)) => *sum = self.tape.add(*sum, p),
                    None => events.push((event, p)),
                }
            }
        }
        events.sort_by(|a, b| a.0.time.total_cmp(&b.0.time));
        Ok(SoftValue::Events(events))
    }

    /// The kind of the added object is that of the most probable one of the set.
    fn add_another(&mut self, op: Called) -> Result<SoftValue, Halt> {
        let at = self.stack.len().checked_sub(operand_count(&Op::Call(op)));
        let Some(at) = at else { return Err(self.mismatch(op)) };
        let SoftValue::Objects(members) = self.stack.remove(at) else {
            return Err(self.mismatch(op));
        };
        let mut alike: Vec<usize> = vec![];
        for (k, p) in members.iter().enumerate() {
            let more = alike.first().map_or(ONE, |best| self.tape.sub(*p, members[*best]));
            if self.tape.is_above(more, 0.0) {
                alike = vec![k];
            }
        }
        let (direction, length, beside) = (self.choices(op)?, self.choices(op)?, self.choices(op)?);
        let [(way, _), (far, _)] = [direction.first(), length.first()]
            .map(|c| c.cloned().unwrap_or((ProgramValue::Bool(false), ZERO)));
        let mut results = vec![];
        for (object, p) in beside {
            let stack = vec![ProgramValue::Objects(alike.clone()), object, far.clone(), way.clone()];
            let value = self.value(op, stack)?;
            add_choice(self.tape, &mut results, value, p);
        }
        Ok(self.given(results))
    }
}

/// Least probability of an object whose counterfactual is simulated.
const LEAST_CHANGE: f64 = 1e-3;
