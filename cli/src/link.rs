//! A blocking call at a time over a serial port: the one place with a clock.

use std::io::{self, ErrorKind};
use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::{Ling, MAX_FRAME, Request, Response};
use armwire::{Client, Config, Event, Input, Micros, Protocol, Reason};
#[cfg(unix)]
use rustix::fs::{FlockOperation, flock};
#[cfg(unix)]
use rustix::termios::{ControlModes, InputModes, ioctl_tiocexcl, ioctl_tiocnxcl};
#[cfg(unix)]
use serial2::Settings;
use serial2::{KeepSettings, SerialPort};

use crate::Port;
use crate::problem::{Heard, Problem};

/// Bytes kept of what was heard instead of an answer.
const KEPT: usize = 256;
/// More bytes than a port keeps for its reader: whoever has read so many reads what is being said now.
const BUFFERED: usize = 65_536;
/// How long a port may take no bytes. The longest request takes less than 40 ms on a line of 9600 baud.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// An open port with a client on it.
pub(crate) struct Link {
    name: String,
    config: Config,
    port: SerialPort,
    client: Client<Ling, MAX_FRAME>,
    start: Instant,
    dropped: usize,
}

impl Link {
    pub(crate) fn open(port: &Port) -> Result<Self, Problem> {
        let open = open(&port.port, port.baud).map_err(|error| Problem::Open {
            port: port.port.clone(),
            error,
        })?;
        let config = Config {
            baud: port.baud,
            // The system may be busy, and nobody waits for us but a person.
            latency: Micros::from_millis(50),
            ..Config::default()
        };
        Ok(Self {
            name: port.port.clone(),
            config,
            port: open,
            client: Client::new(config),
            start: Instant::now(),
            dropped: 0,
        })
    }

    /// Makes one call and returns the answer, if the request gets one.
    pub(crate) fn call(&mut self, request: Request) -> Result<Option<Response>, Problem> {
        // Every call runs to its end, so none is in flight.
        let _ = self.client.submit(request);
        let has_answer = Ling::reply(&request).is_some();
        let begun = self.now();
        let mut heard = Heard::default();
        let mut buf = [0; 256];
        loop {
            // Before it transmits this takes what has arrived, so that no old answer is taken for a new one.
            let n = self.receive(&mut buf)?;
            let bytes = &buf[..n];
            heard.count += n;
            let room = KEPT - heard.bytes.len();
            heard.bytes.extend(bytes.iter().take(room));

            let now = self.now();
            let mut input = Input::Bytes(bytes);
            while let Some(event) = self.client.handle(now, &mut input) {
                match event {
                    Event::Answer(response) => return Ok(Some(response)),
                    Event::Sent => return Ok(None),
                    Event::TimedOut { sends } => {
                        heard.sends = sends;
                        heard.millis = now.since(begun).0 / 1_000;
                        heard.begun = is_begun(&request, &heard.bytes);
                        return Err(Problem::NoAnswer {
                            port: self.name.clone(),
                            baud: self.config.baud,
                            heard: Box::new(heard),
                        });
                    }
                    Event::Late(_) | Event::Unsolicited(_) => heard.frames += 1,
                    Event::Unknown(error) => heard.unknown = heard.unknown.or(Some(error)),
                    Event::Echo(_) => heard.echoes += 1,
                    Event::Noise(noise) | Event::Broken(noise) => {
                        self.dropped += noise.len;
                        heard.checksums += usize::from(matches!(noise.reason, Reason::Checksum { .. }));
                    }
                }
            }
            if n == 0 || heard.count > BUFFERED || !has_answer {
                self.transmit()?;
            }
        }
    }

    /// Bytes that belonged to no frame, so far.
    pub(crate) fn dropped(&self) -> usize {
        self.dropped
    }

    /// Time since the port was opened.
    pub(crate) fn now(&self) -> Micros {
        Micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    pub(crate) fn sleep_until(&self, instant: Micros) {
        thread::sleep(Duration::from_micros(instant.since(self.now()).0));
    }

    fn transmit(&mut self) -> Result<(), Problem> {
        loop {
            let now = self.now();
            let Some(bytes) = self.client.poll_transmit(now) else {
                return Ok(());
            };
            match self.port.write(bytes) {
                Ok(n) if n > 0 => self.client.transmitted(self.now(), n),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if !is_nothing_yet(&error) => return Err(self.lost(error)),
                Ok(_) | Err(_) => {
                    return Err(Problem::Stuck {
                        port: self.name.clone(),
                    });
                }
            }
        }
    }

    /// What has arrived, waiting for it until the client has something to do.
    fn receive(&mut self, buf: &mut [u8]) -> Result<usize, Problem> {
        let due = self.client.poll_timeout().unwrap_or_default();
        // The library counts in milliseconds; rounded down, the last one would be spent without a pause.
        let wait = Duration::from_millis(due.since(self.now()).0.div_ceil(1_000));
        self.port.set_read_timeout(wait).map_err(|error| self.lost(error))?;
        match self.port.read(buf) {
            // Silence is a timeout, so this is the end.
            Ok(0) => Err(self.lost(ErrorKind::BrokenPipe.into())),
            Ok(n) => Ok(n),
            Err(error) if is_nothing_yet(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn lost(&self, error: io::Error) -> Problem {
        Problem::Lost {
            port: self.name.clone(),
            error,
        }
    }
}

#[cfg(unix)]
impl Drop for Link {
    fn drop(&mut self) {
        // A terminal that somebody else has open too, such as the server of a pty, would refuse all who come after us.
        let _ = ioctl_tiocnxcl(&self.port);
    }
}

/// Opens a port for us alone, with nothing in it to read.
fn open(name: &str, baud: u32) -> io::Result<SerialPort> {
    // The settings of a port that another program uses are not ours to change.
    let mut port = SerialPort::open(name, KeepSettings)?;
    #[cfg(unix)]
    flock(&port, FlockOperation::NonBlockingLockExclusive)?;
    let mut settings = port.get_configuration()?;
    settings.set_raw();
    settings.set_baud_rate(baud)?;
    #[cfg(unix)]
    hear_all(&mut settings);
    port.set_configuration(&settings)?;
    // What an earlier program did not read is not for us.
    port.discard_input_buffer()?;
    port.set_write_timeout(WRITE_TIMEOUT)?;
    // This keeps out those who do not ask for the lock.
    #[cfg(unix)]
    ioctl_tiocexcl(&port)?;
    Ok(port)
}

/// Turns the receiver on, whatever the modem lines say, and takes a break for a byte: a wrong baud rate may show as one.
#[cfg(unix)]
fn hear_all(settings: &mut Settings) {
    let termios = settings.as_termios_mut();
    termios.c_cflag |= (ControlModes::CREAD | ControlModes::CLOCAL).bits();
    termios.c_iflag &= !InputModes::IGNBRK.bits();
}

fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

/// Whether an answer to the request begins somewhere in the bytes: with the request's header, command and function.
fn is_begun(request: &Request, bytes: &[u8]) -> bool {
    let mut out = [0; MAX_FRAME];
    let sent = Ling::encode_request(request, &mut out).unwrap_or(0);
    let answered = |window: &&[u8]| window[..3] == out[..3] && window[3] != out[3];
    sent > 3 && bytes.windows(4).any(|window| answered(&window))
}
