//! Read masks: the fields of a reply that a caller wants.

use super::violations::Violations;
use crate::api::DESCRIPTORS;
use prost::Message;
use prost_types::{DescriptorProto, FieldMask, FileDescriptorSet};
use std::collections::{BTreeMap, HashMap};
use std::sync::OnceLock;

/// Most paths of one mask.
const MAX_PATHS: usize = 100;

/// Fields of a message by name: number, and the message that it is.
type Fields = HashMap<String, (u32, Option<String>)>;

/// Which fields of a message remain.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadMask {
    whole: bool,
    /// By number.
    fields: BTreeMap<u32, ReadMask>,
}

/// Fields of all messages of the interface, by name such as `.vrdp.v1.Video`.
fn messages() -> &'static HashMap<String, Fields> {
    static MESSAGES: OnceLock<HashMap<String, Fields>> = OnceLock::new();
    MESSAGES.get_or_init(|| {
        let mut found = HashMap::new();
        for file in FileDescriptorSet::decode(DESCRIPTORS).unwrap_or_default().file {
            let package = format!(".{}", file.package());
            file.message_type.iter().for_each(|message| collect(&mut found, &package, message));
        }
        found
    })
}

fn collect(found: &mut HashMap<String, Fields>, scope: &str, message: &DescriptorProto) {
    let name = format!("{scope}.{}", message.name());
    message.nested_type.iter().for_each(|nested| collect(found, &name, nested));
    let field = |f: &prost_types::FieldDescriptorProto| {
        (f.name().to_string(), (f.number() as u32, f.type_name.clone()))
    };
    found.insert(name, message.field.iter().map(field).collect());
}

impl ReadMask {
    /// The mask of a request for messages called `message`, such as `Video`; without paths it keeps all.
    pub fn new(violations: &mut Violations, given: Option<FieldMask>, message: &str) -> ReadMask {
        let paths = given.unwrap_or_default().paths;
        let mut mask = ReadMask { whole: paths.is_empty(), ..ReadMask::default() };
        if paths.len() > MAX_PATHS {
            violations.add("read_mask.paths", format!("are {}; at most {MAX_PATHS}", paths.len()));
        }
        for (i, path) in paths.iter().take(MAX_PATHS).enumerate() {
            if !mask.add(path, &format!(".vrdp.v1.{message}")) {
                let problem =
                    format!("is {path:?}, which is no field of {message}; write such as `name` or `*`");
                violations.add(format!("read_mask.paths[{i}]"), problem);
            }
        }
        mask
    }

    /// Adds a path; `false` if the message has no such field.
    fn add(&mut self, path: &str, message: &str) -> bool {
        if path == "*" {
            self.whole = true;
            return true;
        }
        let (name, rest) = path.split_once('.').map_or((path, None), |(name, rest)| (name, Some(rest)));
        let Some((number, of)) = messages().get(message).and_then(|fields| fields.get(name)) else {
            return false;
        };
        let field = self.fields.entry(*number).or_default();
        match (rest, of) {
            (None, _) => {
                field.whole = true;
                true
            }
            (Some(rest), Some(of)) => field.add(rest, of),
            (Some(_), None) => false,
        }
    }

    /// The message with the fields that the mask names.
    pub fn apply<M: Message + Default>(&self, message: M) -> M {
        if self.whole {
            return message;
        }
        let mut kept = vec![];
        self.copy(&message.encode_to_vec(), &mut kept);
        // Whole fields of a message that was just encoded are a message again.
        M::decode(kept.as_slice()).unwrap_or_default()
    }

    /// Copies the fields of an encoded message that the mask names.
    fn copy(&self, mut rest: &[u8], kept: &mut Vec<u8>) -> Option<()> {
        while !rest.is_empty() {
            let start = rest;
            let key = varint(&mut rest)?;
            let body = match key & 7 {
                0 => {
                    varint(&mut rest)?;
                    None
                }
                1 => take(&mut rest, 8).map(|_| None)?,
                2 => {
                    let length = varint(&mut rest)?;
                    Some(take(&mut rest, length as usize)?)
                }
                5 => take(&mut rest, 4).map(|_| None)?,
                _ => return None,
            };
            match (self.fields.get(&((key >> 3) as u32)), body) {
                (Some(field), Some(body)) if !field.whole => {
                    let mut part = vec![];
                    field.copy(body, &mut part)?;
                    put_varint(key, kept);
                    put_varint(part.len() as u64, kept);
                    kept.extend(part);
                }
                (Some(_), _) => kept.extend(start.get(..start.len() - rest.len())?),
                (None, _) => {}
            }
        }
        Some(())
    }
}

fn take<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (taken, after) = rest.split_at_checked(length)?;
    *rest = after;
    Some(taken)
}

fn varint(rest: &mut &[u8]) -> Option<u64> {
    prost::encoding::decode_varint(rest).ok()
}

fn put_varint(value: u64, kept: &mut Vec<u8>) {
    prost::encoding::encode_varint(value, kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1;

    fn masked(paths: &[&str], video: v1::Video) -> Result<v1::Video, Vec<String>> {
        let paths = paths.iter().map(|p| p.to_string()).collect();
        let mut violations = Violations::default();
        let mask = ReadMask::new(&mut violations, Some(FieldMask { paths }), "Video");
        match violations.0.is_empty() {
            true => Ok(mask.apply(video)),
            false => Err(violations.0.into_iter().map(|v| v.path).collect()),
        }
    }

    #[test]
    fn masks_keep_what_they_name_and_nothing_else() {
        let object = |id| v1::Object { id, color: "red".into(), mass: Some(2.0), ..Default::default() };
        let table = Some(v1::Table { x_min: -1.0, x_max: 1.0, y_min: -2.0, y_max: 2.0 });
        let objects = vec![object(0), object(300)];
        let video = v1::Video {
            name: "videos/1".into(),
            fps: 25.0,
            table,
            objects,
            times: vec![0.5, 1.5],
            ..Default::default()
        };
        assert_eq!(masked(&[], video.clone()).unwrap(), video);
        assert_eq!(masked(&["name", "*"], video.clone()).unwrap(), video);
        let few = masked(&["fps", "table.x_max", "objects.id", "objects.mass"], video.clone()).unwrap();
        let bare = |id| v1::Object { id, mass: Some(2.0), ..Default::default() };
        let table = Some(v1::Table { x_max: 1.0, ..Default::default() });
        let expected =
            v1::Video { fps: 25.0, table, objects: vec![bare(0), bare(300)], ..Default::default() };
        assert_eq!(few, expected);
        assert_eq!(masked(&["objects", "objects.id"], video.clone()).unwrap().objects, video.objects);
        let wrong = masked(&["name", "colour", "objects.size", "fps.x", ""], video).unwrap_err();
        assert_eq!(
            wrong,
            ["read_mask.paths[1]", "read_mask.paths[2]", "read_mask.paths[3]", "read_mask.paths[4]"]
        );
    }
}
