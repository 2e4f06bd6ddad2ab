//! The demo's options. `cargo demo` has them too, so its help needs no build.

use std::path::PathBuf;

use clap::Args;

#[derive(Args)]
pub(crate) struct DemoOptions {
    /// Keeps running in real time behind a pty, at PATH if given, until Ctrl-C.
    ///
    /// Any serial program can open it. A pty has no modem lines: a program that sets DTR or RTS gets an error.
    #[arg(long, value_name = "PATH")]
    pub(crate) serve: Option<Option<PathBuf>>,

    /// Serves the adapter's control port too, on a pty, at PATH if given. `armwire` opens it as control:PATH.
    #[arg(long, value_name = "PATH", requires = "serve")]
    pub(crate) control: Option<Option<PathBuf>>,

    /// Serves the CAN bus too, behind an SLCAN adapter on a pty, at PATH if given.
    ///
    /// `armwire` opens it as slcan:PATH. python-can opens it with the interface `slcan`. A program has to set the bit
    /// rate, as with LAWICEL's adapters.
    #[arg(long, value_name = "PATH", requires = "serve")]
    pub(crate) slcan: Option<Option<PathBuf>>,

    /// Joints of the arm: 'typical', 'ideal' or a list, as `armwire sim ling --plant` takes it.
    #[arg(long)]
    pub(crate) plant: Option<String>,

    /// Lets gdb attach to the firmware, on this TCP port of this machine.
    #[arg(long, value_name = "PORT")]
    pub(crate) gdb: Option<u16>,
}
