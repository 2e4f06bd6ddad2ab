//! The firmware image when something goes wrong: what is lost is counted, and all else goes on.
