//! How the minimum of the cost is searched.
//!
//! A simulation through contacts is smooth only as long as the same contacts happen; each sequence of contacts has minima of
//! its own. One scene is searched in these steps, each only if the one before leaves a reduced chi-square above 1.25
//! ([`single_scene`]):
//!
//! 1. Levenberg-Marquardt over the whole video ([`local_search`]), for unmeasured yaws from several values ([`yaw_restarts`]);
//! 2. a growing horizon ([`growing_horizon`]): the first frames, then more as far as the simulation follows the tracks. Where it
//!    leaves them ([`divergence`]), the search restarts from other restitutions at the contacts before
//!    ([`restitution_restarts`]), from a contact that the simulation misses ([`missed_contact_restarts`]) and from draws of the
//!    posterior of the frames so far ([`random_restarts`]);
//! 3. other spins of balls ([`spin_restarts`]);
//! 4. draws from the posterior of the frames that are followed, as long as they lower the cost.
//!
//! [`staged_lbfgs`] is the method of the VRDP paper, for comparison.

mod divergence;
mod growing_horizon;
mod local_search;
pub(super) mod missed_contact_restarts;
mod random_restarts;
pub(super) mod restitution_restarts;
mod single_scene;
mod spin_restarts;
mod staged_lbfgs;
mod yaw_restarts;

pub use local_search::Termination;
pub(super) use local_search::{Solution, better, minimise, minimise_from};
pub(super) use single_scene::search_single;
pub(super) use staged_lbfgs::minimise as minimise_in_stages;

#[cfg(test)]
pub(super) use divergence::divergences;
