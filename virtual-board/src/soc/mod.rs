//! The common parts of all chips. They use the core's bus interface, and are independent of the chip.
//!
//! * [`clock`]: ticks of a clock and virtual time;
//! * [`events`]: the time of each peripheral's next event;
//! * [`gdb`]: a debugger on a TCP port;
//! * [`lines`]: levels of the interrupt lines;
//! * [`peripheral`]: a peripheral's registers, as seen by the bus;
//! * [`violations`]: accesses and states that fail a run;
//! * [`chance`]: seeded choices within the limits of a data sheet;
//! * [`machine`]: the core and a chip, run in virtual time.

pub(crate) mod chance;
pub(crate) mod clock;
pub(crate) mod events;
pub(crate) mod gdb;
pub(crate) mod lines;
pub(crate) mod machine;
pub(crate) mod peripheral;
pub(crate) mod violations;
