//! CAN identifiers: function and node.

use armwire::OutOfRange;
use serde::{Deserialize, Serialize};

use super::Id;

/// An adapter's number on a bus: the low four bits of each identifier.
///
/// ```
/// use armwire_bridge::can::Node;
///
/// assert_eq!(Node::new(15).unwrap().get(), 15);
/// assert_eq!(Node::new(16).unwrap_err().to_string(), "node id is 16, must be 0..=15");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(try_from = "u8", into = "u8")]
pub struct Node(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=Self::MAX.0)))] u8,
);

impl Node {
    /// The highest node.
    pub const MAX: Self = Self(15);

    /// Node `node`, 0..=15.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `node` is over 15.
    pub const fn new(node: u8) -> Result<Self, OutOfRange> {
        if node > Self::MAX.0 {
            return Err(OutOfRange {
                what: "node id",
                unit: "",
                got: node as u16,
                min: 0,
                max: Self::MAX.0 as u16,
            });
        }
        Ok(Self(node))
    }

    /// The node's number.
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl TryFrom<u8> for Node {
    type Error = OutOfRange;

    fn try_from(node: u8) -> Result<Self, OutOfRange> {
        Self::new(node)
    }
}

impl From<Node> for u8 {
    fn from(node: Node) -> Self {
        node.get()
    }
}

/// A frame's function. An identifier consists of a function and, in its low four bits, the [`Node`].
///
/// Commands have priority over telemetry, and telemetry over ISO-TP: the lower identifier wins arbitration.
///
/// ```
/// use armwire_bridge::can::{Function, Id, Node};
///
/// let node = Node::new(3).unwrap();
/// let id = Function::JointsA.id(node);
/// assert_eq!(id, Id::new(0x203).unwrap());
/// assert_eq!(Function::of(id), Some((Function::JointsA, node)));
/// assert_eq!(Function::of(Id::new(0x7DF).unwrap()), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u16)]
pub enum Function {
    /// To the adapter: targets of joints 1 to 3. Off by default.
    CommandA = 0x100,
    /// To the adapter: targets of joints 4 to 6. Off by default.
    CommandB = 0x110,
    /// From the adapter: positions of joints 1 to 3.
    JointsA = 0x200,
    /// From the adapter: positions of joints 4 to 6.
    JointsB = 0x210,
    /// From the adapter: gripper, motion status, sequence counter and flags.
    State = 0x220,
    /// From the adapter: error counts.
    Errors = 0x230,
    /// From the adapter: an event, such as a refusal, a host timeout or a recovery from bus-off.
    Event = 0x240,
    /// To the adapter by ISO-TP, one arm frame in each PDU, and its flow control for [`ArmAnswer`](Self::ArmAnswer).
    ArmRequest = 0x600,
    /// From the adapter by ISO-TP, one arm frame in each PDU, and its flow control for [`ArmRequest`](Self::ArmRequest).
    ArmAnswer = 0x610,
    /// To the adapter by ISO-TP, one control message in each PDU, and the flow control for
    /// [`ControlAnswer`](Self::ControlAnswer).
    ControlRequest = 0x640,
    /// From the adapter by ISO-TP, one control message in each PDU, and the flow control for
    /// [`ControlRequest`](Self::ControlRequest).
    ControlAnswer = 0x650,
}

impl Function {
    /// All functions, in the order of their identifiers.
    pub const ALL: [Self; 11] = [
        Self::CommandA,
        Self::CommandB,
        Self::JointsA,
        Self::JointsB,
        Self::State,
        Self::Errors,
        Self::Event,
        Self::ArmRequest,
        Self::ArmAnswer,
        Self::ControlRequest,
        Self::ControlAnswer,
    ];

    /// The identifier of node 0.
    pub const fn base(self) -> u16 {
        self as u16
    }

    /// The identifier of `node`.
    pub const fn id(self, node: Node) -> Id {
        Id(self.base() | node.0 as u16)
    }

    /// The function and node of `id`. `None` if it belongs to no adapter.
    pub fn of(id: Id) -> Option<(Self, Node)> {
        let node = id.get() & u16::from(Node::MAX.0);
        let base = id.get() - node;
        let function = Self::ALL.into_iter().find(|function| function.base() == base)?;
        Some((function, Node(node as u8)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifier_maps_to_exactly_one_meaning() {
        let mut known = 0;
        for id in 0..=Id::MAX.get() {
            let id = Id::new(id).unwrap();
            if let Some((function, node)) = Function::of(id) {
                assert_eq!(function.id(node), id);
                known += 1;
            }
        }
        assert_eq!(known, Function::ALL.len() * 16);
    }

    #[test]
    fn identifiers_are_ordered_by_urgency_with_node_bits() {
        assert!(Function::ALL.is_sorted_by_key(|function| function.base()));
        for function in Function::ALL {
            assert_eq!(function.base() & 0xF, 0);
            assert!(Id::new(function.base()).is_ok());
        }
    }
}
