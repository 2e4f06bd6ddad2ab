//! Parts of the texts of messages. Text from outside is escaped.
//!
//! This layer is for implementations of other arms. It is less stable than the [client](crate::Client): see
//! [Stability](crate#stability).

pub use crate::hex::Hex;
pub use crate::named::Named;
