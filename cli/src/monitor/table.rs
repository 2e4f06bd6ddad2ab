//! Readings for other programs: comma-separated values, or a JSON object per line.

use armwire_bridge::Instant;
use armwire_host::describe::number;
use serde_json::{Map, Value, json};

use super::model::{Latest, Model};

/// The columns of a reading, with units in the names. Missing values are null.
///
/// Without a reading, the row of a missing answer: the columns of the last reading, without values.
pub(super) fn row(model: &Model, now: Instant, latest: Option<&Latest>) -> Map<String, Value> {
    let mut row = Map::new();
    let mut put = |column: &str, value: Value| row.insert(column.to_owned(), value);
    let at = latest.map_or(now, |latest| latest.at);
    let stamp = latest.and_then(|latest| latest.stamp);
    let latency = latest.and_then(|latest| latest.latency);
    put("time_s", number(at.as_micros() as f64 / 1e6));
    put("adapter_time_us", json!(stamp.map(|stamp| stamp.0)));
    put("latency_us", json!(latency.map(|latency| latency.as_micros())));
    // All readings of an arm have the same items.
    let known = latest.or(model.latest.as_ref()).map_or(&[][..], |latest| &latest.facts);
    for item in known.iter().flat_map(|fact| &fact.items) {
        put(&item.key, latest.map_or(Value::Null, |_| item.value.clone()));
    }
    for i in 0..model.servos {
        let celsius = model.celsius.get(i).filter(|_| latest.is_some());
        put(&format!("temperature_{}_celsius", i + 1), json!(celsius));
    }
    row
}

/// The first line: the names of columns.
pub(super) fn csv_head(row: &Map<String, Value>) -> String {
    let names: Vec<_> = row.keys().map(String::as_str).collect();
    names.join(",")
}

/// A line of values. Null is empty.
pub(super) fn csv_line(row: &Map<String, Value>) -> String {
    let fields: Vec<_> = row.values().map(csv_field).collect();
    fields.join(",")
}

/// A field in the quotation of RFC 4180.
fn csv_field(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) if text.contains([',', '"', '\n']) => format!("\"{}\"", text.replace('"', "\"\"")),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use armwire_bridge::control::Stamp;

    use super::*;
    use crate::monitor::model::tests::latest;
    use armwire_host::describe::Fact;

    #[test]
    fn row_has_units_and_null_for_missing_values() {
        let mut model = Model::new("COM3");
        model.servos = 3;
        model.celsius = vec![31, 30];
        let mut latest = latest(1_500, 900, &[Some(0.1), None]);
        latest.facts[1] = Fact::words("status", "odd, \"very\"");
        let line = row(&model, Instant::ZERO, Some(&latest));
        assert_eq!(
            Value::Object(line.clone()).to_string(),
            r#"{"time_s":1.5,"adapter_time_us":null,"latency_us":900,"joint_1_rad":0.1,"joint_2_rad":null,"status":"odd, \"very\"","temperature_1_celsius":31,"temperature_2_celsius":30,"temperature_3_celsius":null}"#
        );
        assert_eq!(
            csv_head(&line),
            "time_s,adapter_time_us,latency_us,joint_1_rad,joint_2_rad,status,temperature_1_celsius,temperature_2_celsius,\
             temperature_3_celsius"
        );
        assert_eq!(csv_line(&line), "1.5,,900,0.1,,\"odd, \"\"very\"\"\",31,30,");
    }

    #[test]
    fn timeout_is_an_empty_row_of_same_columns() {
        let mut model = Model::new("COM3");
        model.servos = 1;
        model.celsius = vec![31];
        let mut stamped = latest(1_000, 900, &[Some(0.1)]);
        stamped.stamp = Some(Stamp(123));
        let full = row(&model, Instant::ZERO, Some(&stamped));
        assert_eq!(full["adapter_time_us"], 123);
        model.read(stamped);
        let empty = row(&model, Instant::from_millis(2_000), None);
        assert_eq!(csv_head(&empty), csv_head(&full));
        assert_eq!(csv_line(&empty), "2.0,,,,,");
    }

    #[test]
    fn non_finite_numbers_are_null() {
        let model = Model::new("COM3");
        let line = row(
            &model,
            Instant::ZERO,
            Some(&latest(0, 0, &[Some(f32::NAN), Some(f32::INFINITY)])),
        );
        assert_eq!(csv_line(&line), "0.0,,0,,,locked");
    }
}
