//! Names of resources: `videos/{id}`, `videos/{id}/models/{id}`, `traces/{id}`, `operations/{id}`,
//! `lexica/{id}`.

pub fn video_name(id: &str) -> String {
    format!("videos/{id}")
}

pub fn model_name(video: &str, id: &str) -> String {
    format!("videos/{video}/models/{id}")
}

pub fn trace_name(id: &str) -> String {
    format!("traces/{id}")
}

pub fn operation_name(id: &str) -> String {
    format!("operations/{id}")
}

pub fn lexicon_name(id: &str) -> String {
    format!("lexica/{id}")
}

/// Whether a text has the form of an id.
pub fn is_id(id: &str) -> bool {
    (1..=64).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

/// Ids of the video and of the model that a name holds.
pub fn model_ids(name: &str) -> Option<(&str, &str)> {
    let (video, model) = name.strip_prefix("videos/")?.split_once("/models/")?;
    (is_id(video) && is_id(model)).then_some((video, model))
}
