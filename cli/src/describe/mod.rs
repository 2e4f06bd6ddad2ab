//! Arms and their messages in words: one file for each protocol.

mod alpha1;
pub(crate) mod legacy;
mod ling;
mod xarm;

use armwire::Config;
use armwire::messages::Messages;

pub(crate) use alpha1::running;
pub(crate) use ling::{gripper, joint, list};
pub(crate) use xarm::torque_source;

/// An angle as `+0.7854 rad  +45.00°`.
pub(crate) fn angle(radians: f32) -> String {
    format!("{radians:+.4} rad {:+7.2}°", radians.to_degrees())
}

/// A protocol, and what the command line says of it.
pub(crate) trait Arm: Messages + Default {
    /// What the arm is called, with its article.
    const NAME: &'static str;

    /// How its line is treated unless the user says otherwise.
    const CONFIG: Config;

    /// With how many bytes of its request an answer begins.
    const HEADER: usize;

    /// A request in words.
    fn show_request(request: &Self::Request<'_>) -> String;

    /// A response in words.
    fn show_response(response: &Self::Response<'_>) -> String;

    /// Why the arm did not do what it was asked, if that is what the response says.
    fn refusal(response: &Self::Response<'_>) -> Option<String>;

    /// The rest of a frame besides its message, in parentheses, such as its number.
    fn envelope(_frame: &[u8]) -> String {
        String::new()
    }
}
