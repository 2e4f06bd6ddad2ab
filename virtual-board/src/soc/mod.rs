//! The parts that every chip is made of. They know the core's connection to the chip, and no chip.
//!
//! * [`clock`]: ticks of a clock and virtual time;
//! * [`events`]: when each peripheral is to be called next;
//! * [`gdb`]: a debugger at a TCP port;
//! * [`lines`]: levels of the interrupt lines;
//! * [`peripheral`]: a peripheral's registers as the bus sees them;
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
