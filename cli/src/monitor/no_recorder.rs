//! The recorder of a build without recordings.

use std::path::Path;

use armwire_host::Link;
use armwire_host::describe::{Arm, Protocol};

use super::reading::OnFrame;
use crate::error::Error;

/// Records nothing.
pub(super) struct Recorder;

impl Recorder {
    pub(super) fn new(_path: Option<&Path>) -> Self {
        Self
    }

    pub(super) fn is_on(&self) -> bool {
        false
    }

    pub(super) fn tapped<P: Arm>(&self, link: Link<P>) -> Link<P> {
        link
    }

    pub(super) fn on_frame(&self, _protocol: Protocol) -> Option<OnFrame> {
        None
    }

    pub(super) fn create(&mut self) -> Result<(), Error> {
        Ok(())
    }

    pub(super) fn write(&mut self) -> Result<(), Error> {
        Ok(())
    }

    pub(super) fn finish(self) -> Result<(), Error> {
        Ok(())
    }
}
