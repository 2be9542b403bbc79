//! What other rooms know of an effect: its role, the data that determine it, what it covers, where a search starts.
//!
//! A room that needs an effect with a certain property asks for the property, never for a name.

/// What kind of statement an effect makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A law of motion or contact: what a discovery looks for.
    Law,
    /// What real tables and engines do beside the laws (an uneven foot, numerical damping, a contact margin). Presets and fits
    /// use it; it is never a discovery.
    Nuisance,
    /// A property of an object that differs from the assumed one.
    Matter,
    /// An error of the camera or the tracker.
    Camera,
}

/// On what an effect acts, where that is less than everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActsOn {
    Everything,
    /// Objects that slide on a foot; a ball has none.
    SlidingFeet,
    /// Objects that touch a wall of the table.
    TableWalls,
}

/// The meaning of a parameter for the code that handles all effects alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParamRole {
    /// 1 if the thing exists; it is not fitted.
    Presence,
    /// One of the seeds and nothing between; it is not fitted.
    Choice,
    /// Restitution between objects: what the set-up has in common.
    CommonRestitution,
    /// Restitution between objects: factor of one object.
    ObjectRestitution,
    /// Restitution between objects: ratio of one pair's value to what the others say.
    PairRestitution,
    /// Restitution at something that is no object of the scene: a wall, a hidden obstacle.
    WallRestitution,
    /// Friction of the ground is proportional to it.
    GroundFriction,
    /// It moves no centre of mass, or another parameter compensates it: free motion does not determine it.
    UnseenInFreeMotion,
}

/// The form of a hidden obstacle. Its effect has these parameters in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObstacleForm {
    /// Presence, offset (m), angle of the normal (rad), restitution.
    Wall,
    /// Presence, centre x and y (m), radius (m), restitution.
    Disc,
    /// Presence, left, right, bottom and top (m), restitution.
    Rectangle,
}

/// Where a search starts an effect to which the derivative at "absent" does not lead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SearchStart {
    /// At these values of the first parameter, each with all seeds of the others.
    Amplitudes(&'static [f64]),
    /// At these values of all parameters, which are not fitted: it acts fully or not at all.
    AllOrNothing(&'static [f64]),
    /// At the amplitude at which the longest contact takes this number of frames ([`super::Effect::contact_time`]).
    ContactFrames(f64),
    /// At the amplitude with which restitution falls by half at a usual speed: the first parameter is 1/v0 (s/m).
    RestitutionDecay,
    /// At each object's own value over the median of all: only ratios of masses show. The first parameter is factor - 1.
    RatioToMedian,
    /// Behind changes of velocity that no object explains.
    BehindImpacts(ObstacleForm),
}

/// What is known of an effect beside its formula.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    pub role: Role,
    pub acts_on: ActsOn,
    /// Names of the effects for which it stands: none of them is a candidate beside it. An effect that covers others is a
    /// formulation that presets choose, and no candidate itself.
    pub covers: &'static [&'static str],
    /// Meanings of parameters, by their names.
    pub param_roles: &'static [(&'static str, ParamRole)],
    /// A first parameter of a smaller absolute value is no discovery: every engine and camera deviates as much.
    pub negligible: f64,
    /// Where a search starts it, beside the seeds; `None`: the derivative at "absent" leads to it.
    pub start: Option<SearchStart>,
    /// Prior deviations, by parameter, with which a search for laws adds it to a model that lacks it, so that no law is found
    /// in what it does.
    pub nuisance_priors: &'static [(&'static str, f64)],
    /// Whether contacts show it although its hooks act between them.
    pub shows_at_contacts: bool,
    /// Whether it acts differently for a while after a contact (a ball slides until it rolls): windows around contacts then
    /// determine it, and not free motion alone.
    pub changes_after_contact: bool,
    /// Whether it can hold a body at rest.
    pub holds_at_rest: bool,
    /// Its force or acceleration as a formula, up to a factor: the right sides for x and y of each part.
    pub formula_terms: &'static [[&'static str; 2]],
    /// Size that its amplitudes have where nature gives it (in their unit).
    pub constant_of_nature: Option<f64>,
    /// The group of effects that people switch off as one: friction (of the ground), object_friction (between objects), drag.
    pub common_name: Option<&'static str>,
}

impl Profile {
    /// A law that the derivative at "absent" leads to.
    pub const LAW: Profile = Profile {
        role: Role::Law,
        acts_on: ActsOn::Everything,
        covers: &[],
        param_roles: &[],
        negligible: 0.0,
        start: None,
        nuisance_priors: &[],
        shows_at_contacts: false,
        changes_after_contact: false,
        holds_at_rest: false,
        formula_terms: &[],
        constant_of_nature: None,
        common_name: None,
    };
    /// What real tables and engines do beside the laws.
    pub const NUISANCE: Profile = Profile { role: Role::Nuisance, ..Profile::LAW };
    /// A property of an object that differs from the assumed one.
    pub const MATTER: Profile = Profile { role: Role::Matter, ..Profile::LAW };
    /// An error of the camera or the tracker.
    pub const CAMERA: Profile = Profile { role: Role::Camera, ..Profile::LAW };

    /// The meaning of a parameter, if it has one for the code that handles all effects alike.
    pub fn param_role(&self, parameter: &str) -> Option<ParamRole> {
        self.param_roles.iter().find(|(name, _)| *name == parameter).map(|(_, role)| *role)
    }
}
