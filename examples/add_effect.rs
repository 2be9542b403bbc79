//! A client of the service: posts videos, compares, discovers, adds the found effect, and prints the errors.
//!
//! `vrdp serve` in one terminal, then `cargo run --release --example add_effect -- http://127.0.0.1:50051 FILE...`, where
//! each FILE is an `observed.json` or a CSV file of one video, all of one set-up.

use std::error::Error;
use std::path::Path;
use tonic::transport::Channel;
use vrdp::api::v1::models_client::ModelsClient;
use vrdp::api::v1::videos_client::VideosClient;
use vrdp::api::v1::{
    AddEffectRequest, CompareModelsRequest, CreateVideoRequest, DiscoverEffectsRequest, Formula, Revision,
    StudyRequest, add_effect_request, add_effect_response, compare_models_response,
    discover_effects_response,
};
use vrdp::scene::{parse, parse_csv};

/// Largest accepted reply in bytes: discoveries hold trajectories of long videos.
const MAX_MESSAGE: usize = 64 << 20;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let url = arguments.next().ok_or("give the URL of the service, then files of videos")?;
    let channel = Channel::from_shared(url)?.connect().await?;

    // 1. Post the videos. The same content gives the same video.
    let mut client = VideosClient::new(channel.clone());
    let mut videos = vec![];
    for file in arguments {
        let (text, name) = (std::fs::read_to_string(&file)?, Path::new(&file).display().to_string());
        let scene = if file.ends_with(".csv") { parse_csv(&name, &text)? } else { parse(&name, &text)? };
        let request = CreateVideoRequest {
            video: Some(vrdp::api::video_message("", &scene, true)),
            ..Default::default()
        };
        videos.push(client.create_video(request).await?.into_inner().name);
    }

    // 2. Compare: how well does the default model fit, and where does it fail?
    let mut models = ModelsClient::new(channel).max_decoding_message_size(MAX_MESSAGE);
    let study = StudyRequest { videos, ..Default::default() };
    let request = CompareModelsRequest { study: Some(study.clone()), ..Default::default() };
    let mut stream = models.compare_models(request).await?.into_inner();
    while let Some(message) = stream.message().await? {
        if let Some(compare_models_response::Event::Comparison(c)) = message.event {
            println!("compare: {}", c.summary);
        }
    }

    // 3. Discover: which effect is missing?
    let request = DiscoverEffectsRequest { study: Some(study.clone()), ..Default::default() };
    let mut stream = models.discover_effects(request).await?.into_inner();
    let mut found = None;
    while let Some(message) = stream.message().await? {
        if let Some(discover_effects_response::Event::Discovery(discovery)) = message.event {
            found = Some(discovery);
        }
    }
    let found = found.ok_or("the search ended without a result")?;
    println!("discover: {:?}, {}", found.verdict(), found.reason);

    // 4. Add the effect to the first model. A formula, from the search or your own, is added as text.
    let addition = match (found.effects.first(), found.formula.as_str()) {
        (_, text) if !text.is_empty() => {
            let law = Formula { name: "found".into(), text: text.into(), parameters: vec![] };
            add_effect_request::Addition::Formula(law)
        }
        (Some(effect), _) => add_effect_request::Addition::Effect(effect.effect.clone()),
        (None, _) => return Ok(()),
    };
    let first = found.revisions.first().map(|r| r.models.clone()).unwrap_or_default();
    let study = StudyRequest { models: first, ..study };
    let request = AddEffectRequest { study: Some(study), addition: Some(addition) };
    let mut stream = models.add_effect(request).await?.into_inner();

    // 5. Print the errors before and after.
    while let Some(message) = stream.message().await? {
        match message.event {
            Some(add_effect_response::Event::Progress(f)) => eprintln!("{:3.0} %", 100.0 * f),
            Some(add_effect_response::Event::Revised(revised)) => {
                revised.before.iter().chain(&revised.after).for_each(show);
            }
            None => {}
        }
    }
    Ok(())
}

fn show(r: &Revision) {
    let mm = |v: f64| 1e3 * v;
    println!(
        "revision {} {}: rmse {:.2} mm, held out {:.2} mm, noise {:.2} mm; {:?}, model {}",
        r.revision,
        r.effect,
        mm(r.rmse),
        mm(r.held_out_rmse),
        mm(r.noise_sigma),
        r.worth(),
        r.models.first().map_or("", String::as_str),
    );
}
