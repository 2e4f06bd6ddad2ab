//! The firmware image on the virtual board.

mod arms;
mod boards;
mod boot;
mod busy;
mod bytes;
mod campaign;
mod can;
mod canfd;
mod control;
mod copy;
mod crash_loop;
mod delayed;
mod flash;
mod latency;
mod line;
mod ling;
mod poll;
mod rate;
mod recovery;
mod selftest;
mod start;
mod stop;
mod teleop;
mod trace;
mod usb;
mod usb_faults;
