//! How far the lessons determine the weights of a family, and probabilities that say so.
//!
//! The logits of an object with D standardised features f are linear in x = (f/sqrt(D), 1). A question whose right
//! answer has the probability P, with derivatives g of ln P by the logits, tells of right or wrong and has the information
//! `P/(1 - P) g g^T` (a binomial's). For word w of K, h_w = sum_o g_ow x_o over the objects o, it adds up to
//!
//! `H = sum_q P/(1 - P) sum_w h_w h_w^T`, of which w has the share `r_w = K/(K - 1) tr(H_w)/tr(H)`.
//!
//! Only differences of logits count: for two words the factor K/(K - 1) makes their difference exact. Each weight of x has the prior
//! variance 1, so that more features are no stronger. Laplace's posterior gives the logit the variance `s_w^2 = x^T (1 + r_w H)^-1 x`, and
//!
//! `P(w) ~ 1 / sum_j e^((m_j - m_w) k_jw)`, `k_jw = 1/sqrt(1 + pi (s_j^2 + s_w^2)/8)`,
//!
//! which for two words is the moderated output of MacKay, Neural Computation 4 (1992) 720. Few lessons, or an object unlike those of the
//! lessons, give probabilities nearer to each other.

use crate::num::elementary::exp;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Most directions in which the information is kept; perception has 29.
const MOST_DIRECTIONS: usize = 64;

/// x of an object.
pub fn input(features: &[f64]) -> DVector<f64> {
    let scale = 1.0 / (features.len().max(1) as f64).sqrt();
    DVector::from_iterator(features.len() + 1, features.iter().map(|f| scale * f).chain([1.0]))
}

/// The information that lessons have of the weights of a family, by its principal directions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WeightInformation {
    /// Eigenvectors of H, one row after the other.
    pub directions: Vec<f64>,
    /// Their eigenvalues.
    pub amounts: Vec<f64>,
    /// r_w of each word.
    pub shares: Vec<f64>,
}

/// H and the traces of its parts, while lessons are added.
pub struct InformationSum {
    sum: DMatrix<f64>,
    traces: Vec<f64>,
}

impl InformationSum {
    pub fn new(words: usize, features: usize) -> InformationSum {
        InformationSum { sum: DMatrix::zeros(features + 1, features + 1), traces: vec![0.0; words] }
    }

    /// Adds a question's h of one word, with the weight of its information.
    pub fn add(&mut self, word: usize, h: &DVector<f64>, weight: f64) {
        self.sum.ger(weight, h, h, 1.0);
        self.traces[word] += weight * h.norm_squared();
    }

    pub fn finish(self) -> WeightInformation {
        let total: f64 = self.traces.iter().sum();
        let words = self.traces.len() as f64;
        let share = |trace: &f64| match total > 0.0 && words > 1.0 {
            true => words / (words - 1.0) * trace / total,
            false => 0.0,
        };
        let shares = self.traces.iter().map(share).collect();
        let eigen = SymmetricEigen::new(self.sum);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        order.truncate(MOST_DIRECTIONS);
        let directions =
            order.iter().flat_map(|k| eigen.eigenvectors.column(*k).iter().copied().collect::<Vec<_>>());
        let directions = directions.collect();
        let amounts = order.iter().map(|k| eigen.eigenvalues[*k].max(0.0)).collect();
        WeightInformation { directions, amounts, shares }
    }
}

impl WeightInformation {
    /// Whether it has all numbers for these words and features.
    pub fn is_whole(&self, words: usize, features: usize) -> bool {
        let numbers = self.amounts.len().checked_mul(features + 1);
        self.shares.len() == words && numbers == Some(self.directions.len())
    }

    /// s_w^2 of each word for an object with these features.
    fn variances(&self, features: &[f64]) -> Vec<f64> {
        let x = input(features);
        let along = |direction: &[f64]| {
            let part: f64 = direction.iter().zip(x.iter()).map(|(d, x)| d * x).sum();
            part * part
        };
        let parts: Vec<f64> = self.directions.chunks(x.len()).map(along).collect();
        let rest = (x.norm_squared() - parts.iter().sum::<f64>()).max(0.0);
        let of = |share: &f64| {
            let each = parts.iter().zip(&self.amounts).map(|(part, amount)| part / (1.0 + share * amount));
            rest + each.sum::<f64>()
        };
        self.shares.iter().map(of).collect()
    }

    /// P(w) of each word, given the logits m.
    pub fn moderated(&self, logits: &[f64], features: &[f64]) -> Vec<f64> {
        let variances = self.variances(features);
        let of = |(m, v): (&f64, &f64)| {
            let odds = |(other, w): (&f64, &f64)| {
                exp((other - m) / (1.0 + std::f64::consts::PI * (v + w) / 8.0).sqrt())
            };
            1.0 / logits.iter().zip(&variances).map(odds).sum::<f64>()
        };
        let each: Vec<f64> = logits.iter().zip(&variances).map(of).collect();
        let total: f64 = each.iter().sum();
        each.into_iter().map(|p| p / total).collect()
    }
}
