//! Words for what a body looks like: colour and material, with probabilities.
//!
//! A surface of albedo a (linear light, 0 to 1) also mirrors a share `HAZE` of white light, so that its light is that of
//! `a + HAZE`. Against a grey ground of albedo g, `ln(a + HAZE) - ln(g + HAZE)` has the mean l and the chroma (red - l, blue - l).
//! The colour is the word whose chroma is nearest: `P(word) ~ exp(-d^2/(2 CHROMA_SIGMA^2))`; words of no chroma (grey, black,
//! white) differ in l. The colours are CLEVR's (Johnson et al., CVPR 2017), as published with its renderer.
//!
//! Material: a matt body scatters the lamps' light and has about the lightness l of its colour. A mirror shows the room, which is
//! darker than the lamps, and the lamps as small highlights. So a metal's median lightness lies far below l (measured on rendered
//! videos, 54 bodies of 8 colours: rubber 0.1 to 0.65, metal 0.9 to 1.45), and its brightest pixels far above its median. The room
//! is grey, so that a mirror's chroma is less than its colour's (metal 0.84 to 1.01 of it, rubber 0.98 to 1.08).

use super::appearance::AppearanceFeatures;
use crate::num::elementary::{exp, ln, powf};

/// A word with its probability.
pub(super) type Word = (&'static str, f64);

/// CLEVR's colours (sRGB), and three more of billiard balls.
const COLOURS: [(&str, [u8; 3]); 11] = [
    ("gray", [87, 87, 87]),
    ("red", [173, 35, 35]),
    ("blue", [42, 75, 215]),
    ("green", [29, 105, 20]),
    ("brown", [129, 74, 25]),
    ("purple", [129, 38, 192]),
    ("cyan", [41, 208, 208]),
    ("yellow", [255, 238, 51]),
    ("white", [235, 235, 235]),
    ("black", [20, 20, 20]),
    ("orange", [230, 120, 30]),
];
/// How many of them are CLEVR's.
pub(super) const CLEVR_COLOURS: usize = 8;
/// Share of white light that every surface mirrors: half the 4 % of plastics at normal incidence; here as the camera sees it.
const HAZE: f64 = 0.015;
/// Albedo of a grey ground: CLEVR's.
const GROUND_ALBEDO: f64 = 0.29;
/// Deviation of chroma within one colour, over lights and shading (largest measured distance: 0.3).
const CHROMA_SIGMA: f64 = 0.2;
/// Deviation of the median lightness within a word of no chroma, over materials.
const LIGHTNESS_SIGMA: f64 = 0.7;
/// Median lightness below the colour's own where matt and metal are equally likely, and the logit's slope.
const METAL_DEFICIT: f64 = 0.85;
const DEFICIT_SLOPE: f64 = 10.0;
/// Chroma as a share of the colour's own where they are equally likely, and the logit's slope: 0.08 between the means of both, each with
/// a deviation of 0.055.
const METAL_CHROMA: f64 = 1.01;
const CHROMA_SLOPE: f64 = 25.0;
/// Lightness of the highlights above the median where they are equally likely; it counts a tenth as much.
const HIGHLIGHT_CONTRAST: f64 = 1.2;

/// Lightness and chroma of a colour against the ground.
fn against_ground(rgb: [u8; 3]) -> (f64, [f64; 2]) {
    let light = |c: u8| {
        let x = f64::from(c) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { powf((x + 0.055) / 1.055, 2.4) }
    };
    let d = rgb.map(|c| ln(light(c) + HAZE) - ln(GROUND_ALBEDO + HAZE));
    let l = d.iter().sum::<f64>() / 3.0;
    (l, [d[0] - l, d[2] - l])
}

/// The most probable of the first `words` colours.
pub(super) fn color(features: &AppearanceFeatures, words: usize) -> Word {
    let median = features.lightness[2];
    let weights = COLOURS.iter().take(words.clamp(1, COLOURS.len())).map(|&(word, rgb)| {
        let (l, chroma) = against_ground(rgb);
        let square = |a: f64, b: f64, sigma: f64| (a - b) * (a - b) / (sigma * sigma);
        // A matt body is a third darker than its colour, a metal much more.
        let lightness = square(median, l - 0.5 * METAL_DEFICIT, LIGHTNESS_SIGMA);
        let distance = square(features.chroma[0], chroma[0], CHROMA_SIGMA)
            + square(features.chroma[1], chroma[1], CHROMA_SIGMA)
            + if words > CLEVR_COLOURS { lightness } else { 0.0 };
        (word, exp(-0.5 * distance))
    });
    let weights: Vec<Word> = weights.collect();
    let total: f64 = weights.iter().map(|w| w.1).sum();
    let best = weights.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(("", 0.0));
    // Far from all colours nothing is sure.
    (best.0, if total > 1e-12 { best.1 / total } else { 1.0 / words as f64 })
}

/// Signs of a mirror: how far the median lightness lies below that of the colour, the highlights above the median, and the chroma as a
/// share of the colour's own. `None` for a word that is no colour.
pub(super) fn mirror_signs(features: &AppearanceFeatures, color: &str) -> Option<[f64; 3]> {
    let &(_, rgb) = COLOURS.iter().find(|c| c.0 == color)?;
    let (own, chroma) = against_ground(rgb);
    let contrast = (features.lightness[5] - features.lightness[2]).min(2.0 * HIGHLIGHT_CONTRAST);
    Some([own - features.lightness[2], contrast, chroma_share(features.chroma, chroma)])
}

/// "metal" or "rubber".
pub(super) fn material(features: &AppearanceFeatures, color: &str) -> Word {
    let Some([deficit, contrast, share]) = mirror_signs(features, color) else { return ("rubber", 0.5) };
    let logit = DEFICIT_SLOPE * (deficit - METAL_DEFICIT)
        + 0.1 * DEFICIT_SLOPE * (contrast - HIGHLIGHT_CONTRAST)
        + CHROMA_SLOPE * (METAL_CHROMA - share);
    let metal = 1.0 / (1.0 + exp(-logit.clamp(-30.0, 30.0)));
    if metal > 0.5 { ("metal", metal) } else { ("rubber", 1.0 - metal) }
}

/// Chroma along a colour's own as a share of it, within 0.2 of the limit; the limit where the colour has none.
fn chroma_share(seen: [f64; 2], own: [f64; 2]) -> f64 {
    let square = own[0] * own[0] + own[1] * own[1];
    if square < CHROMA_SIGMA * CHROMA_SIGMA {
        return METAL_CHROMA;
    }
    let share = (seen[0] * own[0] + seen[1] * own[1]) / square;
    share.clamp(METAL_CHROMA - 0.2, METAL_CHROMA + 0.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn features(chroma: [f64; 2], median: f64, highlight: f64) -> AppearanceFeatures {
        let l = median;
        AppearanceFeatures {
            chroma,
            lightness: [l - 0.5, l - 0.2, l, l + 0.2, l + 0.4, highlight],
            highlight_chroma: chroma,
        }
    }

    #[test]
    fn each_colour_is_its_own_word_in_both_materials() {
        for (word, rgb) in COLOURS.iter().take(CLEVR_COLOURS) {
            let (l, chroma) = against_ground(*rgb);
            let matt = features(chroma.map(|c| 1.05 * c), l - 0.4, l + 0.2);
            let metal = features(chroma.map(|c| 0.92 * c), l - 1.2, l + 0.5);
            for (look, expected) in [(matt, "rubber"), (metal, "metal")] {
                let (found, sure) = color(&look, CLEVR_COLOURS);
                assert!(found == *word && sure > 0.95, "{word} {found} {sure}");
                let (found, sure) = material(&look, word);
                assert!(found == expected && sure > 0.9, "{word} {expected} {sure}");
            }
        }
    }

    #[test]
    fn a_light_mirror_is_known_by_its_pale_colour() {
        for word in ["purple", "cyan", "brown"] {
            let rgb = COLOURS.iter().find(|c| c.0 == word).unwrap().1;
            let (l, chroma) = against_ground(rgb);
            let look = |share: f64| features(chroma.map(|c| share * c), l - METAL_DEFICIT, l - 0.25);
            assert_eq!(material(&look(0.94), word).0, "metal");
            assert_eq!(material(&look(1.06), word).0, "rubber");
        }
    }

    #[test]
    fn white_grey_and_black_differ_in_lightness() {
        for (word, rgb) in [("white", [235; 3]), ("gray", [87; 3]), ("black", [20; 3])] {
            let (l, chroma) = against_ground(rgb);
            assert_eq!(color(&features(chroma, l - 0.4, l), COLOURS.len()).0, word);
        }
    }
}
