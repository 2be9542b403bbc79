//! The optimiser and the prior of the weights.

use crate::concepts::lexicon::LearnedFamily;

const MOMENTS: [f64; 2] = [0.9, 0.99];

/// The start of the vectors of words: that of word k is unit vector k.
pub fn unit_vectors(words: usize, dimension: usize) -> Vec<f64> {
    let mut vectors = vec![0.0; words * dimension];
    (0..words).for_each(|w| vectors[w * dimension + w] = 1.0);
    vectors
}

/// The prior of the weights: normal around 0 for W, around the unit vectors for e.
pub fn add_prior(families: &[LearnedFamily], precision: f64, gradient: &mut [Vec<f64>]) {
    for (k, family) in families.iter().enumerate() {
        let centre = unit_vectors(family.words.len(), family.dimension);
        gradient[3 * k].iter_mut().zip(&family.map).for_each(|(g, w)| *g += precision * w);
        let vectors = family.vectors.iter().zip(&centre);
        gradient[3 * k + 2].iter_mut().zip(vectors).for_each(|(g, (e, c))| *g += precision * (e - c));
    }
}

/// First and second moments of the gradient of each block of parameters: W, u, e of each family.
pub struct Adam {
    moments: Vec<[Vec<f64>; 2]>,
    powers: [f64; 2],
}

impl Adam {
    pub fn new(families: &[LearnedFamily]) -> Adam {
        let sizes = families.iter().flat_map(|f| [f.map.len(), f.offset.len(), f.vectors.len()]);
        Adam { moments: sizes.map(|n| [vec![0.0; n], vec![0.0; n]]).collect(), powers: [1.0, 1.0] }
    }

    pub fn zeros(&self) -> Vec<Vec<f64>> {
        self.moments.iter().map(|m| vec![0.0; m[0].len()]).collect()
    }

    pub fn step(&mut self, families: &mut [LearnedFamily], gradient: &[Vec<f64>], rate: f64) {
        let [b1, b2] = MOMENTS;
        self.powers = [self.powers[0] * b1, self.powers[1] * b2];
        let blocks = families.iter_mut().flat_map(|f| [&mut f.map, &mut f.offset, &mut f.vectors]);
        for ((block, g), [first, second]) in blocks.zip(gradient).zip(&mut self.moments) {
            for (k, x) in block.iter_mut().enumerate() {
                first[k] = b1 * first[k] + (1.0 - b1) * g[k];
                second[k] = b2 * second[k] + (1.0 - b2) * g[k] * g[k];
                let (m, v) = (first[k] / (1.0 - self.powers[0]), second[k] / (1.0 - self.powers[1]));
                *x -= rate * m / (v.sqrt() + 1e-8);
            }
        }
    }
}
