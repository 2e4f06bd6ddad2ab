//! The formats of recordings.

use clap::ValueEnum;

/// The format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// The bytes of a line as they are.
    Raw,
    /// The bytes of a line as hexadecimal digits, such as 'AA 06 00 01 FE 9A FF'.
    Hex,
    /// The bytes of a line as decimal numbers, such as '170 6 0 1 254 154 255'.
    Dec,
    /// A log of 'candump -L', or the output of 'candump'.
    Candump,
    /// A Vector ASC log.
    Asc,
    /// A PEAK trace, version 1.0 to 2.1.
    Trc,
    /// A Vector BLF log.
    Blf,
    /// A CSV log of python-can.
    Csv,
    /// A CSV log of GVRET or SavvyCAN.
    Gvret,
    /// Text of python-can, as in its logs of the type TXT.
    Printer,
    /// A capture of Wireshark or tcpdump, pcap or pcapng, of CAN or USB, or of 'armwire decode --pcapng'.
    Pcap,
    /// A recording of 'armwire monitor --mcap'.
    Mcap,
    /// A hex dump with offsets, of xxd, hexdump or od.
    Dump,
    /// A hex dump whose groups are in the order of the file, as of 'xxd -g 4'.
    DumpBe,
    /// A hex dump whose groups are little-endian, as of 'xxd -e'.
    DumpLe,
    /// The lines of a program's log: prefix, direction such as RX: or TX:, and bytes in hexadecimal, as b'...', or as a
    /// list or an array. See --tx.
    Log,
}

impl Format {
    /// Returns true for the bytes of a line.
    pub(super) fn is_of_line(self) -> bool {
        use Format::{Dec, Dump, DumpBe, DumpLe, Hex, Log, Raw};
        matches!(self, Raw | Hex | Dec | Dump | DumpBe | DumpLe | Log)
    }

    /// Returns true for a log of a CAN bus.
    pub(super) fn is_of_bus(self) -> bool {
        !self.is_of_line() && !matches!(self, Self::Mcap | Self::Pcap)
    }
}
