//! The samples of all objects on both sides of a pair of neighbouring frames, and what paths without and with a contact leave of them.
//!
//! The path of an object is a parabola, or one with a contact: at one pair of frames the velocity changes, and the place with it, as nobody
//! knows when in between the contact was. Beside the pair in question a contact moves the later path by o = -tau dv, with one
//! time tau of both coordinates; in it a free o would be what is tested. A contact is rare and has five parameters: its price in chi-square is
//! `CONTACT`, so that it counts only where a parabola fails.

use crate::num::elementary;
use crate::scene::observation::{Sample, Scene, Track};

/// Samples on each side of a pair of frames, where a contact is near, and fewest of them.
const SIDE: usize = 6;
const NEARER: usize = 4;
const FEWEST: usize = 3;
/// Odds that show an event, and sizes that it may have.
const ODDS: f64 = 1e5;
const SIZES: f64 = 10.0;
/// Fall that one object must show of what all have in common: odds of 10 to 1.
const SHOWS: f64 = 4.6;
/// Price of a contact: odds of 10^4 to 1 (18.4) against one near a given pair of frames.
const CONTACT: f64 = 18.4;
/// A leap that is worth a look (deviations of the difference of three positions).
const LEAP: f64 = 2.5;

/// Fall of chi-square that shows an event among all pairs of so many frames.
pub fn proof(frames: usize) -> f64 {
    2.0 * elementary::ln(ODDS * SIZES * frames as f64)
}

/// Whether chance, and a noise that is a tenth too small, leave this chi-square.
pub fn is_noise(chi_square: f64, degrees: f64) -> bool {
    chi_square < 1.2 * degrees + 4.0 * (2.0 * degrees).sqrt()
}

/// What the best paths leave of the samples.
#[derive(Debug, Clone, Copy, Default)]
pub struct Remains {
    pub chi_square: f64,
    pub degrees_of_freedom: f64,
    /// Price of the contacts in them.
    pub price: f64,
}

impl Remains {
    /// Twice the negative logarithm of the likelihood, up to a constant.
    pub fn deviance(&self) -> f64 {
        self.chi_square + self.price
    }

    fn plus(self, one: Remains) -> Remains {
        Remains {
            chi_square: self.chi_square + one.chi_square,
            degrees_of_freedom: self.degrees_of_freedom + one.degrees_of_freedom,
            price: self.price + one.price,
        }
    }

    pub fn are_noise(&self) -> bool {
        is_noise(self.chi_square, self.degrees_of_freedom)
    }
}

/// Those of all objects that were seen on both sides.
pub struct Sides(Vec<Side>);

impl Sides {
    /// Frames before and after a pair whose samples may be among its sides.
    pub const REACH: usize = 2 * SIDE;

    /// `noises` are the deviations of the tracks (m).
    pub fn of(scene: &Scene, frame: usize, noises: &[f64]) -> Sides {
        Sides::within(scene, frame, noises, SIDE)
    }

    /// The same without the samples farthest away: a contact may be among them.
    pub fn nearer(scene: &Scene, frame: usize, noises: &[f64]) -> Sides {
        Sides::within(scene, frame, noises, NEARER)
    }

    fn within(scene: &Scene, frame: usize, noises: &[f64], side: usize) -> Sides {
        let all = scene.tracks.iter().zip(noises);
        let of = |(track, noise): (&Track, &f64)| Side::of(scene, &track.samples, (frame, side), *noise);
        Sides(all.filter_map(of).collect())
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether any object leaps over the pair.
    pub fn leap(&self) -> bool {
        self.0.iter().any(Side::leaps)
    }

    /// What paths leave where the times of later samples (s, from the earlier frame) are others.
    pub fn remains(&self, later: impl Fn(f64) -> f64) -> Remains {
        self.0.iter().map(|side| side.remains(&later)).fold(Remains::default(), Remains::plus)
    }

    /// What paths without a contact leave.
    pub fn smooth(&self, later: impl Fn(f64) -> f64) -> Remains {
        self.0.iter().map(|side| side.smooth(&later).0).fold(Remains::default(), Remains::plus)
    }

    /// How many objects show such times.
    pub fn showing(&self, later: impl Fn(f64) -> f64) -> usize {
        let fall = |side: &&Side| side.smooth(&|t| t).0.chi_square - side.smooth(&later).0.chi_square;
        self.0.iter().filter(|side| fall(side) > SHOWS).count()
    }

    /// The displacement of all later samples (m) that leaves least, by how much it lowers the deviance, and whether it leaves noise; it
    /// lowers nothing unless each object shows it.
    pub fn displacement(&self) -> ([f64; 2], f64, bool) {
        let (mut weight, mut shift) = (0.0, [0.0; 2]);
        let (mut without, mut with) = (0.0, Remains::default());
        for side in &self.0 {
            let (step, rest) = side.step();
            let still = side.remains(&|t| t).deviance();
            if still - rest.deviance() < SHOWS {
                return ([0.0; 2], 0.0, false);
            }
            without += still;
            with.chi_square += rest.chi_square;
            with.degrees_of_freedom += rest.degrees_of_freedom + 2.0;
            with.price += rest.price;
            // m^-2, and the step in metres.
            let own = step.0 / (side.noise * side.noise);
            weight += own;
            (0..2).for_each(|c| shift[c] += own * step.1[c] * side.noise);
            with.chi_square += step.0 * (step.1[0] * step.1[0] + step.1[1] * step.1[1]);
        }
        if weight <= 0.0 {
            return (shift, 0.0, false);
        }
        with.degrees_of_freedom -= 2.0;
        for c in &mut shift {
            with.chi_square -= *c * *c / weight;
            *c /= weight;
        }
        (shift, without - with.deviance(), with.are_noise())
    }
}

/// Time (s), position in deviations, and whether the point is after the pair.
type Point = (f64, [f64; 2], bool);

/// One object's samples beside a pair of frames.
struct Side {
    points: Vec<Point>,
    /// m.
    noise: f64,
}

impl Side {
    fn of(scene: &Scene, samples: &[Sample], (frame, side): (usize, usize), noise: f64) -> Option<Side> {
        let after = samples.partition_point(|s| s.frame <= frame);
        let (first, last) = (after.saturating_sub(side), (after + side).min(samples.len()));
        let near = |s: &Sample| s.frame + 2 * side > frame && s.frame < frame + 2 * side;
        if after < first + FEWEST
            || last < after + FEWEST
            || !near(&samples[first])
            || !near(&samples[last - 1])
        {
            return None;
        }
        let (start, middle) = (scene.time_of(frame), samples[after].position);
        let point = |(k, s): (usize, &Sample)| {
            let at = (s.position - middle).scaled(1.0 / noise);
            (scene.time_of(s.frame) - start, [at.x, at.y], first + k >= after)
        };
        Some(Side { points: samples[first..last].iter().enumerate().map(point).collect(), noise })
    }

    fn after(&self) -> usize {
        self.points.partition_point(|p| !p.2)
    }

    /// Whether the step over the pair is another than those beside it.
    fn leaps(&self) -> bool {
        let after = self.after();
        let step = |k: usize| -> Option<[f64; 2]> {
            let (a, b) = (self.points.get(k.checked_sub(1)?)?, self.points.get(k)?);
            Some([0, 1].map(|c| (b.1[c] - a.1[c]) / (b.0 - a.0).max(f64::MIN_POSITIVE)))
        };
        let (Some(before), Some(over), Some(behind)) = (step(after - 1), step(after), step(after + 1)) else {
            return false;
        };
        let time = self.points[after].0 - self.points[after - 1].0;
        let off = |c: usize| (over[c] - 0.5 * (before[c] + behind[c])) * time;
        // Of a step less the mean of its neighbours: variance 2 + 2 * 2 / 4 + 2 (they share a position each).
        elementary::hypot(off(0), off(1)) > LEAP * 5.0_f64.sqrt()
    }

    /// What a parabola leaves, the later points at other times; and all times.
    fn smooth(&self, later: &impl Fn(f64) -> f64) -> (Remains, Vec<f64>) {
        let times: Vec<f64> = self.points.iter().map(|p| if p.2 { later(p.0) } else { p.0 }).collect();
        let chi_square = self.regression(&times, |_| [0.0; 2], 0).chi_square;
        let degrees_of_freedom = 2.0 * (times.len() as f64 - 3.0);
        (Remains { chi_square, degrees_of_freedom, price: 0.0 }, times)
    }

    /// What the best path leaves, the later points at other times.
    fn remains(&self, later: &impl Fn(f64) -> f64) -> Remains {
        let (smooth, times) = self.smooth(later);
        if smooth.chi_square < CONTACT + smooth.degrees_of_freedom {
            return smooth;
        }
        let contact = self.contacts().map(|k| {
            let free = |i: usize| if i < k { [0.0; 2] } else { [1.0, times[i] - times[k]] };
            let beside = self.regression(&times, free, 2);
            if k != self.after() {
                return beside.chi_square;
            }
            // The velocity changes by dv at the time that the displacement o = -tau dv shows.
            let (o, dv) = ([0, 1].map(|c| beside.extra[c][0]), [0, 1].map(|c| beside.extra[c][1]));
            let square = (dv[0] * dv[0] + dv[1] * dv[1]).max(f64::MIN_POSITIVE);
            let at = times[k] - (o[0] * dv[0] + o[1] * dv[1]) / square;
            let at = at.clamp(times[k - 1], times[k]);
            let bent = |i: usize| if i < k { [0.0; 2] } else { [times[i] - at, 0.0] };
            self.regression(&times, bent, 1).chi_square
        });
        let chi_square = contact.fold(f64::INFINITY, f64::min);
        if chi_square + CONTACT < smooth.chi_square {
            let degrees_of_freedom = smooth.degrees_of_freedom - 4.0;
            return Remains { chi_square, degrees_of_freedom, price: CONTACT };
        }
        smooth
    }

    /// First points after a contact that may be in the sides.
    fn contacts(&self) -> std::ops::RangeInclusive<usize> {
        1..=self.points.len() - 1
    }

    /// The weight and the size (deviations) of a step over the pair, and what it leaves, beside a contact or without.
    fn step(&self) -> ((f64, [f64; 2]), Remains) {
        let times: Vec<f64> = self.points.iter().map(|p| p.0).collect();
        let after = self.after();
        let step = |i: usize| if i < after { 0.0 } else { 1.0 };
        let smooth = self.regression(&times, |i| [step(i), 0.0], 1);
        let count = times.len() as f64;
        let of = |fit: &Regression, degrees: f64, price: f64| {
            let rest =
                Remains { chi_square: fit.chi_square, degrees_of_freedom: 2.0 * (count - degrees), price };
            ((fit.weight, [fit.extra[0][0], fit.extra[1][0]]), rest)
        };
        let best = of(&smooth, 4.0, 0.0);
        let time = |i: usize| times[i] - 0.5 * (times[after - 1] + times[after]);
        let bent = self.regression(&times, |i| [step(i), if i < after { 0.0 } else { time(i) }], 2);
        if bent.chi_square + CONTACT < smooth.chi_square { of(&bent, 5.0, CONTACT) } else { best }
    }

    /// Least squares of the points by 1, t, t^2 and the first `count` of two more columns, by orthogonal columns (Gram and Schmidt, twice
    /// for round-off): sums of squares would lose the noise beside the way.
    fn regression(&self, times: &[f64], more: impl Fn(usize) -> [f64; 2], count: usize) -> Regression {
        let unit = times.iter().map(|t| t.abs()).fold(f64::MIN_POSITIVE, f64::max);
        let points = self.points.len().min(2 * SIDE);
        let mut columns = [[0.0; 2 * SIDE]; 5];
        for i in 0..points {
            let (t, extra) = (times[i] / unit, more(i));
            [1.0, t, t * t, extra[0], extra[1]].into_iter().enumerate().for_each(|(k, x)| columns[k][i] = x);
        }
        let mut left = [0, 1].map(|c| {
            let mut left = [0.0; 2 * SIDE];
            left.iter_mut().zip(&self.points).for_each(|(l, p)| *l = p.1[c]);
            left
        });
        let dot = |a: &[f64; 2 * SIDE], b: &[f64; 2 * SIDE]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let take = |from: &mut [f64; 2 * SIDE], share: f64, column: &[f64; 2 * SIDE]| {
            from.iter_mut().zip(column).for_each(|(f, c)| *f -= share * c);
        };
        // Lengths of the extra columns beside those before, the share of the first in the second, and of both in the points.
        let (mut lengths, mut shared, mut shares) = ([0.0; 2], 0.0, [[0.0; 2]; 2]);
        for k in 0..3 + count {
            let (before, rest) = columns.split_at_mut(k);
            let column = &mut rest[0];
            let whole = dot(column, column).sqrt();
            for _ in 0..2 {
                for (j, known) in before.iter().enumerate() {
                    let share = dot(known, column);
                    take(column, share, known);
                    shared += if (j, k) == (3, 4) { share } else { 0.0 };
                }
            }
            let length = dot(column, column).sqrt();
            if length <= 1e-9 * whole {
                *column = [0.0; 2 * SIDE];
                continue;
            }
            column.iter_mut().for_each(|x| *x /= length);
            for (c, left) in left.iter_mut().enumerate() {
                for _ in 0..2 {
                    let share = dot(column, left);
                    take(left, share, column);
                    if k >= 3 {
                        shares[c][k - 3] += share;
                    }
                }
            }
            if k >= 3 {
                lengths[k - 3] = length;
            }
        }
        let inverse = lengths.map(|l| if l > 0.0 { 1.0 / l } else { 0.0 });
        let extra = shares.map(|s| {
            let second = s[1] * inverse[1];
            [(s[0] - shared * second) * inverse[0], second]
        });
        let variance = inverse[0] * inverse[0] * (1.0 + shared * shared * inverse[1] * inverse[1]);
        let chi_square = left.iter().map(|l| dot(l, l)).sum();
        Regression { chi_square, extra, weight: if variance > 0.0 { 1.0 / variance } else { 0.0 } }
    }
}

struct Regression {
    chi_square: f64,
    /// Coefficients of the two more columns, for both coordinates.
    extra: [[f64; 2]; 2],
    /// Of the first of them: one over its variance, in deviations.
    weight: f64,
}
