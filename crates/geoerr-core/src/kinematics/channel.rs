//! Channels: the places where a displacement enters the chain or the measurement of it.

use serde::{Deserialize, Serialize};

use super::{Axis, Component, KinematicsError};

/// Two axes whose included angle, less 90°, is a squareness (Li §4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum AxisPair {
    /// S_xy.
    Xy,
    /// S_xz.
    Xz,
    /// S_yz.
    Yz,
}

impl AxisPair {
    /// Xy, Xz, Yz: the order of every array of three squarenesses.
    pub const ALL: [Self; 3] = [Self::Xy, Self::Xz, Self::Yz];

    /// 0, 1, 2: the pair's place in every array of three squarenesses.
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The axis that leans: X is the datum, and Y lies in the XY plane.
    #[inline]
    pub const fn leaning(self) -> Axis {
        match self {
            Self::Xy => Axis::Y,
            Self::Xz | Self::Yz => Axis::Z,
        }
    }

    /// The axis that it leans away from, where S is positive.
    #[inline]
    pub const fn datum(self) -> Axis {
        match self {
            Self::Xy | Self::Xz => Axis::X,
            Self::Yz => Axis::Y,
        }
    }
}

/// What a measuring rig adds to a point `p_c`, in the frame of its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum RigError {
    /// Translation along the camera's x, mm.
    TranslationX,
    /// Translation along the camera's y, mm.
    TranslationY,
    /// Translation along the camera's z, mm.
    TranslationZ,
    /// Rotation about the camera's x, rad.
    RotationX,
    /// Rotation about the camera's y, rad.
    RotationY,
    /// Rotation about the camera's z, rad.
    RotationZ,
    /// Scale: `p_c`, each mm/mm.
    Scale,
    /// Focal length: `z_c ẑ_c`, each mm/mm.
    Depth,
    /// Disparity or vergence: `z_c p_c`, each 1/mm.
    Disparity,
    /// The same shift of every ray: `z_c x̂_c`, each mm/mm.
    RayX,
    /// The same shift of every ray: `z_c ŷ_c`, each mm/mm.
    RayY,
}

impl RigError {
    /// All, in the order of every array of rig numbers.
    pub const ALL: [Self; 11] = [
        Self::TranslationX,
        Self::TranslationY,
        Self::TranslationZ,
        Self::RotationX,
        Self::RotationY,
        Self::RotationZ,
        Self::Scale,
        Self::Depth,
        Self::Disparity,
        Self::RayX,
        Self::RayY,
    ];

    /// 0 to 10: its place in every array of rig numbers.
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// A place where a displacement enters: `p_measured − p_nominal = Σ_c J_c(q, l) f_c`.
///
/// ```
/// # use geoerr_core::kinematics::Channel;
/// let yaw = Channel::parse("ECX")?;
/// assert_eq!((yaw.name(), yaw.index(), yaw.is_rig()), ("ECX", 5, false));
/// assert!(Channel::parse("rig-scale")?.is_rig());
/// # Ok::<(), geoerr_core::kinematics::KinematicsError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Channel {
    /// An error of one axis by its ISO 230-1 name, mm or rad: `ECX` is Li's ε_zx.
    Joint(Axis, Component),
    /// Included angle of two axes, less 90°, rad: `S_xy`.
    Squareness(AxisPair),
    /// The tool's own displacement in the base frame, mm: `tool-x`.
    Tool(Axis),
    /// The work's own displacement in the base frame, mm: `work-x`.
    Work(Axis),
    /// The target's own displacement on the tool or the work, mm: `target-x`.
    Target(Axis),
    /// What the measuring rig adds, in the camera's frame: `rig-scale`.
    Rig(RigError),
    /// Along the target's own nominal motion by one axis, mm: `motion-x`. For errors of timing.
    Motion(Axis),
}

const NAMES: [&str; Channel::COUNT] = [
    "EXX",
    "EYX",
    "EZX",
    "EAX",
    "EBX",
    "ECX",
    "EXY",
    "EYY",
    "EZY",
    "EAY",
    "EBY",
    "ECY",
    "EXZ",
    "EYZ",
    "EZZ",
    "EAZ",
    "EBZ",
    "ECZ",
    "S_xy",
    "S_xz",
    "S_yz",
    "tool-x",
    "tool-y",
    "tool-z",
    "work-x",
    "work-y",
    "work-z",
    "target-x",
    "target-y",
    "target-z",
    "rig-tx",
    "rig-ty",
    "rig-tz",
    "rig-rx",
    "rig-ry",
    "rig-rz",
    "rig-scale",
    "rig-depth",
    "rig-disparity",
    "rig-ray-x",
    "rig-ray-y",
    "motion-x",
    "motion-y",
    "motion-z",
];

const fn all() -> [Channel; Channel::COUNT] {
    let mut all = [Channel::Joint(Axis::X, Component::X); Channel::COUNT];
    let mut k = 0;
    while k < Channel::COUNT {
        let third = k % 3;
        all[k] = match k {
            0..18 => Channel::Joint(Axis::ALL[k / 6], Component::ALL[k % 6]),
            18..21 => Channel::Squareness(AxisPair::ALL[third]),
            21..24 => Channel::Tool(Axis::ALL[third]),
            24..27 => Channel::Work(Axis::ALL[third]),
            27..30 => Channel::Target(Axis::ALL[third]),
            30..41 => Channel::Rig(RigError::ALL[k - 30]),
            _ => Channel::Motion(Axis::ALL[k - 41]),
        };
        k += 1;
    }
    all
}

impl Channel {
    /// Number of channels.
    pub const COUNT: usize = 44;

    /// The first so many move a point of the machine: 18 joint errors, squareness, tool, work, target.
    pub const MACHINE_COUNT: usize = 30;

    /// Columns of [`channel_columns`](super::Chain::channel_columns): the machine's channels, then motion.
    pub const BASE_COLUMN_COUNT: usize = Self::MACHINE_COUNT + 3;

    /// Columns of [`Pose::rig_columns`](super::Pose::rig_columns).
    pub const RIG_COLUMN_COUNT: usize = RigError::ALL.len();

    /// All channels, each at its [`index`](Self::index).
    pub const ALL: [Self; Self::COUNT] = all();

    /// The channel's place among all.
    #[inline]
    pub const fn index(self) -> usize {
        match self {
            Self::Joint(axis, component) => 6 * axis.index() + component.index(),
            Self::Squareness(pair) => 18 + pair.index(),
            Self::Tool(axis) => 21 + axis.index(),
            Self::Work(axis) => 24 + axis.index(),
            Self::Target(axis) => 27 + axis.index(),
            Self::Rig(error) => Self::MACHINE_COUNT + error.index(),
            Self::Motion(axis) => Self::MACHINE_COUNT + Self::RIG_COLUMN_COUNT + axis.index(),
        }
    }

    /// Its place among the columns in the base frame; none for what acts in the camera's.
    #[inline]
    pub const fn base_column(self) -> Option<usize> {
        match self {
            Self::Rig(_) => None,
            Self::Motion(axis) => Some(Self::MACHINE_COUNT + axis.index()),
            _ => Some(self.index()),
        }
    }

    /// Its place among the columns in the camera's frame; none for what acts in the base frame.
    #[inline]
    pub const fn rig_column(self) -> Option<usize> {
        match self {
            Self::Rig(error) => Some(error.index()),
            _ => None,
        }
    }

    /// Whether it explains measurements only: the machine does not have it, and it is never compensated.
    #[inline]
    pub const fn is_rig(self) -> bool {
        matches!(self, Self::Rig(_) | Self::Motion(_))
    }

    /// The name that files and commands use.
    pub const fn name(self) -> &'static str {
        NAMES[self.index()]
    }

    /// Reads such a name.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownChannel`].
    pub fn parse(name: &str) -> Result<Self, KinematicsError> {
        let place = NAMES.iter().position(|&known| known == name);
        place
            .map(|place| Self::ALL[place])
            .ok_or_else(|| KinematicsError::UnknownChannel { name: name.to_owned() })
    }
}

/// What a target is fixed to, and from where it is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Carrier {
    /// On the tool, seen from the floor.
    Tool = 0,
    /// On the work, seen from the floor.
    Work = 1,
    /// On the base itself: a fixed reference target, which no channel of the machine moves.
    Base = 2,
    /// On the tool, seen from the work.
    Relative = 3,
}

impl Carrier {
    /// Each at its [`code`](Self::code).
    pub const ALL: [Self; 4] = [Self::Tool, Self::Work, Self::Base, Self::Relative];

    /// 0 to 3, as arrays of carriers have it.
    #[inline]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The name that observations use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tool => "tool",
            Self::Work => "work",
            Self::Base => "base",
            Self::Relative => "relative",
        }
    }

    /// The carrier of a code.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownCarrier`].
    pub fn from_code(code: u8) -> Result<Self, KinematicsError> {
        Self::ALL.get(usize::from(code)).copied().ok_or(KinematicsError::UnknownCarrier { code })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_is_at_its_index_and_reads_back() {
        for (place, channel) in Channel::ALL.into_iter().enumerate() {
            assert_eq!(channel.index(), place);
            assert_eq!(Channel::parse(channel.name()), Ok(channel));
        }
    }

    #[test]
    fn names_say_what_the_variants_say() {
        let named = |name| Channel::parse(name).unwrap();
        assert_eq!(named("EBZ"), Channel::Joint(Axis::Z, Component::B));
        assert_eq!(named("S_yz"), Channel::Squareness(AxisPair::Yz));
        assert_eq!(named("tool-z"), Channel::Tool(Axis::Z));
        assert_eq!(named("work-x"), Channel::Work(Axis::X));
        assert_eq!(named("target-y"), Channel::Target(Axis::Y));
        assert_eq!(named("rig-rx"), Channel::Rig(RigError::RotationX));
        assert_eq!(named("rig-ray-y"), Channel::Rig(RigError::RayY));
        assert_eq!(named("motion-z"), Channel::Motion(Axis::Z));
        for name in ["", "exx", "EC0Y", "S_yx", "rig", "rig-ray-z"] {
            assert_eq!(Channel::parse(name), Err(KinematicsError::UnknownChannel { name: name.to_owned() }));
        }
    }

    #[test]
    fn each_column_is_in_one_frame_or_the_other() {
        let mut base = Vec::new();
        let mut rig = Vec::new();
        for channel in Channel::ALL {
            assert_ne!(channel.base_column().is_some(), channel.rig_column().is_some());
            base.extend(channel.base_column());
            rig.extend(channel.rig_column());
        }
        assert_eq!(base, (0..Channel::BASE_COLUMN_COUNT).collect::<Vec<_>>());
        assert_eq!(rig, (0..Channel::RIG_COLUMN_COUNT).collect::<Vec<_>>());
        assert_eq!(Channel::ALL.iter().filter(|channel| channel.is_rig()).count(), 14);
    }

    #[test]
    fn carriers_by_code() {
        for carrier in Carrier::ALL {
            assert_eq!(Carrier::from_code(carrier.code()), Ok(carrier));
        }
        assert_eq!(Carrier::from_code(4), Err(KinematicsError::UnknownCarrier { code: 4 }));
    }
}
