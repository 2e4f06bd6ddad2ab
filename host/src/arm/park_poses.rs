//! The poses in which arms lie, in files.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use armwire::ling::{JOINTS, Position, SerialNumber};
use etcetera::BaseStrategy;
use serde_json::{Value, json};

use crate::error::Error;

/// The name of the array in a file.
const JOINTS_DEG: &str = "joints_deg";

/// The poses in which arms lie without torque: a folder with a file for each arm, which has the arm's serial number as
/// its name and the angles of joints 1 to 6 in degrees: `{"joints_deg":[0.0,-80.0,75.0,0.0,10.0,0.0]}`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParkPoses(PathBuf);

impl ParkPoses {
    /// Those of this user: `armwire/park` in `$XDG_CONFIG_HOME`, which is `~/.config` by default, or in `%APPDATA%`.
    ///
    /// # Errors
    ///
    /// [`Error::At`] if the user's folder is not known.
    pub fn of_user() -> Result<Self, Error> {
        let user = etcetera::choose_base_strategy().map_err(|error| Error::at("saved poses", error))?;
        Ok(Self(user.config_dir().join("armwire").join("park")))
    }

    /// Those in this folder.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self(folder)
    }

    /// The file of the arm with this serial number.
    ///
    /// # Errors
    ///
    /// [`Error::At`] for a serial number that has other characters than ASCII letters and digits.
    pub fn path(&self, serial: &SerialNumber) -> Result<PathBuf, Error> {
        let name = serial.as_str().filter(|name| !name.is_empty());
        let name = name.filter(|name| name.bytes().all(|byte| byte.is_ascii_alphanumeric()));
        match name {
            Some(name) => Ok(self.0.join(format!("{name}.json"))),
            None => Err(Error::at(
                "saved poses",
                format_args!("the arm's serial number '{serial}' is not of letters and digits"),
            )),
        }
    }

    /// The pose of the arm with this serial number. `None` if none is saved.
    ///
    /// # Errors
    ///
    /// As of [`path`](Self::path); [`Error::At`] if the file cannot be read, or has no pose.
    pub fn read(&self, serial: &SerialNumber) -> Result<Option<[Position; JOINTS]>, Error> {
        let path = self.path(serial)?;
        match fs::read_to_string(&path) {
            Ok(text) => parse(&text).map(Some).map_err(|reason| at(&path, reason)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(at(&path, error)),
        }
    }

    /// Saves the pose of the arm with this serial number. A file with another pose is replaced as a whole.
    ///
    /// # Errors
    ///
    /// As of [`path`](Self::path); [`Error::At`] if the file cannot be written.
    pub fn write(&self, serial: &SerialNumber, pose: &[Position; JOINTS]) -> Result<(), Error> {
        let path = self.path(serial)?;
        let new = path.with_extension("json.new");
        fs::create_dir_all(&self.0)
            .and_then(|()| fs::write(&new, format!("{}\n", json!({ JOINTS_DEG: pose.map(degrees) }))))
            .and_then(|()| fs::rename(&new, &path))
            .map_err(|error| at(&path, error))
    }
}

/// The angle in degrees, rounded to a hundredth: a tick is nine.
fn degrees(position: Position) -> f64 {
    let degrees = f64::from(position.radians()).to_degrees();
    (degrees * 100.0).round() / 100.0
}

/// The pose in the text of a file.
fn parse(text: &str) -> Result<[Position; JOINTS], String> {
    let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let angles = value[JOINTS_DEG].as_array();
    let angles = angles.filter(|angles| angles.len() == JOINTS);
    let angles = angles.ok_or_else(|| format!("{JOINTS_DEG} must be {JOINTS} angles in degrees"))?;
    let mut pose = [Position::CENTRE; JOINTS];
    for (position, (joint, angle)) in pose.iter_mut().zip((1..).zip(angles)) {
        let degrees = angle.as_f64();
        let degrees = degrees.ok_or_else(|| format!("joint {joint} of {JOINTS_DEG} is {angle}, must be a number"))?;
        let radians = degrees.to_radians() as f32;
        *position = Position::from_radians(radians)
            .map_err(|_| format!("joint {joint} of {JOINTS_DEG} is {degrees}, must be -180 to 179.91"))?;
    }
    Ok(pose)
}

fn at(path: &Path, reason: impl std::fmt::Display) -> Error {
    Error::at(&path.display().to_string(), reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SERIAL: SerialNumber = SerialNumber(*b"ADFS251205123456");

    /// An empty folder for one test.
    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("armwire-park-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        path
    }

    #[test]
    fn each_arm_has_its_own_pose() {
        let path = folder("poses");
        let poses = ParkPoses::in_folder(path.clone());
        assert_eq!(poses.read(&SERIAL).unwrap(), None);
        for start in [0, 700, 4_090] {
            let pose = std::array::from_fn(|joint| Position::new(start + joint as u16).unwrap());
            poses.write(&SERIAL, &pose).unwrap();
            assert_eq!(poses.read(&SERIAL).unwrap(), Some(pose));
        }
        let other = SerialNumber(*b"ADFS251205123457");
        assert_eq!(poses.read(&other).unwrap(), None);
        fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn every_position_is_kept() {
        for ticks in 0..=Position::MAX.ticks() {
            let pose = [Position::new(ticks).unwrap(); JOINTS];
            let text = json!({ JOINTS_DEG: pose.map(degrees) }).to_string();
            assert_eq!(parse(&text), Ok(pose), "{text}");
        }
    }

    #[test]
    fn file_without_a_pose_is_named() {
        let path = folder("broken");
        let poses = ParkPoses::in_folder(path.clone());
        fs::create_dir_all(&path).unwrap();
        for (text, reason) in [
            ("", "EOF"),
            ("{}", "joints_deg must be 6 angles in degrees"),
            (r#"{"joints_deg":[0,0,0]}"#, "must be 6 angles"),
            (
                r#"{"joints_deg":[0,0,"x",0,0,0]}"#,
                r#"joint 3 of joints_deg is "x", must be a number"#,
            ),
            (
                r#"{"joints_deg":[0,0,0,0,0,200]}"#,
                "joint 6 of joints_deg is 200, must be -180 to 179.91",
            ),
        ] {
            fs::write(path.join("ADFS251205123456.json"), text).unwrap();
            let error = poses.read(&SERIAL).unwrap_err().to_string();
            assert!(
                error.contains("ADFS251205123456.json: ") && error.contains(reason),
                "{error}"
            );
        }
        fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn serial_number_is_never_a_path() {
        for serial in [
            *b"../../etc/passwd",
            *b"\0ADFS25120512345",
            *b"AD\x1b[31m\x07\0\0\0\0\0\0\0\0",
        ] {
            let error = ParkPoses::in_folder("park".into())
                .path(&SerialNumber(serial))
                .unwrap_err();
            assert!(error.to_string().contains("is not of letters and digits"), "{error}");
        }
    }
}
