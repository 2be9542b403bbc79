//! Whether trajectories bear out what the lenses found: a law that is there lowers their error too.

use super::revise::Revision;
use crate::fit::SceneFit;
use crate::world::ActiveEffect;

/// Reduced chi-square beyond which a trajectory is lost: chaos decides it, not a law.
const LOST: f64 = 4.0;

/// A scene is mended that was off the noise by more than this, and is nearer by this factor (reduced chi-square).
const WELL: f64 = 1.5;
const MENDED: f64 = 2.0;

/// Whether a trajectory is lost.
pub fn lost(scene: &SceneFit) -> bool {
    scene.reduced_chi_square > LOST
}

/// Whether the trajectories of `after` are nearer to what was measured than those of `before`, the price of the added
/// parameters paid (BIC with a misfit of its own in each scene, so that no single one decides). A scene that
/// neither follows says nothing; where that is so of all, free motion decides, each video left out in turn.
pub fn borne_out(before: &Revision, after: &Revision, added: usize) -> bool {
    let scenes = before.fit.scenes.iter().zip(&after.fit.scenes).filter(|(b, a)| !(lost(b) && lost(a)));
    let (mut gain, mut count) = (0.0, 0.0);
    for (b, a) in scenes {
        let n = a.degrees_of_freedom as f64;
        gain += n * (b.reduced_chi_square / a.reduced_chi_square.max(f64::MIN_POSITIVE)).ln();
        count += n;
    }
    // A scene with numbers of its own has paid for none of them yet.
    let own = |r: &Revision| (r.apart.len() * shared(r)) as f64;
    let price = added as f64 + own(after) - own(before);
    if count == 0.0 { after.left_out_rmse < before.left_out_rmse } else { gain > price * count.ln() }
}

/// Whether a fit follows at least two scenes that another does not: one may be lost, and found, by chance.
pub fn mends(before: &[SceneFit], after: &[SceneFit]) -> bool {
    let mended = |(b, a): &(&SceneFit, &SceneFit)| {
        b.reduced_chi_square > f64::max(WELL, MENDED * a.reduced_chi_square) && !lost(a)
    };
    before.iter().zip(after).filter(mended).count() > 1
}

/// How many free numbers the scenes of a revision share.
fn shared(revision: &Revision) -> usize {
    let effects = revision.fit.scenes.first().map_or(&[][..], |s| &s.model.effects);
    let of = |e: &ActiveEffect| {
        let free = e.parameters.iter().filter(|p| p.prior.sd > 0.0 && e.shares(p));
        free.map(|p| p.labels.len()).sum::<usize>()
    };
    effects.iter().filter(|e| e.on).map(of).sum()
}
