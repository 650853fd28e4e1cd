//! First-order effect of every channel of the machine on one point: the columns of a design matrix.

use super::chain::{Axis, Chain};
use super::channel::{AxisPair, Carrier, Channel};
use super::vec3::{Vec3, add, cross, scale};

/// A vector for each channel that acts in the base frame, at its [`Channel::base_column`].
pub type ChannelColumns = [[f64; 3]; Channel::BASE_COLUMN_COUNT];

const UNIT: [Vec3; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl Chain {
    /// Derivative of the point's position by each channel's number, where all of them are 0.
    ///
    /// ```math
    /// \begin{aligned}
    /// \text{tool, of a tool axis:}&\quad \boldsymbol\delta_a + \boldsymbol\varepsilon_a \times
    ///     \Bigl(\mathbf l + \sum_{\text{tool axes outside } a} q_b \hat{\mathbf b}\Bigr)\\
    /// \text{work, of a work axis:}&\quad -\boldsymbol\delta_a - \boldsymbol\varepsilon_a \times
    ///     \Bigl(\mathbf w - \sum_{\text{work axes outside } a} q_b \hat{\mathbf b}\Bigr)\\
    /// \text{relative, of a work axis:}&\quad \boldsymbol\delta_a + \boldsymbol\varepsilon_a \times
    ///     \Bigl(\mathbf l + \sum_{\text{tool}} q_b \hat{\mathbf b} + q_a \hat{\mathbf a}
    ///     + \sum_{\text{work axes inside } a} q_b \hat{\mathbf b}\Bigr)
    /// \end{aligned}
    /// ```
    ///
    /// | symbol | code | meaning | unit |
    /// |---|---|---|---|
    /// | `$q$` | `q_mm` | commanded axis positions | mm |
    /// | `$\mathbf l$` | `tool_offset_mm + offset_mm` | from the carriage origin to the point | mm |
    /// | `$\mathbf w$` | `offset_mm` | the point of the work from the base origin at x = y = z = 0 | mm |
    ///
    /// "Outside" is further from the base. Squareness: `−S_xy y` along x, `−S_xz z` along x, `−S_yz z` along y, of the
    /// axes that carry the point, reversed for the work seen from the base. Seen from the work the work's own
    /// displacement counts negative. Motion: +1 along the axis on the tool, −1 on the work, 0 where it does not
    /// carry the point, +1 for the tool seen from the work.
    ///
    /// # Verified by
    /// `tests/kinematics/columns.rs`: differences of [`Chain::position`] for every channel, carrier and chain.
    pub fn channel_columns(
        &self,
        carrier: Carrier,
        q_mm: &[f64; 3],
        offset_mm: &[f64; 3],
        tool_offset_mm: &[f64; 3],
    ) -> ChannelColumns {
        let mut columns: ChannelColumns = [[0.0; 3]; Channel::BASE_COLUMN_COUNT];
        let own = |columns: &mut ChannelColumns, channel: fn(Axis) -> Channel, sign: f64| {
            for axis in Axis::ALL {
                put(columns, channel(axis), &scale(sign, &UNIT[axis.index()]));
            }
        };
        if carrier != Carrier::Base {
            own(&mut columns, Channel::Target, 1.0);
        }
        match carrier {
            Carrier::Base => {}
            Carrier::Tool | Carrier::Relative => {
                own(&mut columns, Channel::Tool, 1.0);
                let mut lever = add(tool_offset_mm, offset_mm);
                for &axis in self.tool_axes().iter().rev() {
                    axis_columns(&mut columns, axis, q_mm, &lever, 1.0);
                    lever[axis.index()] += q_mm[axis.index()];
                }
                if carrier == Carrier::Relative {
                    own(&mut columns, Channel::Work, -1.0);
                    for &axis in self.work_axes() {
                        lever[axis.index()] += q_mm[axis.index()];
                        axis_columns(&mut columns, axis, q_mm, &lever, 1.0);
                    }
                }
            }
            Carrier::Work => {
                own(&mut columns, Channel::Work, 1.0);
                let mut lever = *offset_mm;
                for &axis in self.work_axes().iter().rev() {
                    axis_columns(&mut columns, axis, q_mm, &lever, -1.0);
                    lever[axis.index()] -= q_mm[axis.index()];
                }
            }
        }
        columns
    }
}

#[inline]
fn put(columns: &mut ChannelColumns, channel: Channel, column: &Vec3) {
    if let Some(place) = channel.base_column() {
        columns[place] = *column;
    }
}

/// Joint errors, squarenesses and motion of one axis that carries the point.
#[inline]
fn axis_columns(columns: &mut ChannelColumns, axis: Axis, q_mm: &Vec3, lever: &Vec3, sign: f64) {
    let first = 6 * axis.index();
    for (direction, unit) in UNIT.iter().enumerate() {
        columns[first + direction] = scale(sign, unit);
        columns[first + 3 + direction] = scale(sign, &cross(unit, lever));
    }
    for pair in AxisPair::ALL {
        if pair.leaning() == axis {
            let leaned = scale(-sign * q_mm[axis.index()], &UNIT[pair.datum().index()]);
            put(columns, Channel::Squareness(pair), &leaned);
        }
    }
    put(columns, Channel::Motion(axis), &scale(sign, &UNIT[axis.index()]));
}
