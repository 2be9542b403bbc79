//! Listings: pages, filters, times and read masks of videos, set-ups, models and revisions.

use crate::harness::*;
use std::collections::BTreeSet;
use tonic::Code;
use vrdp::api::v1;

fn paths(paths: &[&str]) -> Option<prost_types::FieldMask> {
    Some(prost_types::FieldMask { paths: paths.iter().map(|p| p.to_string()).collect() })
}

async fn videos(service: &Running, request: v1::ListVideosRequest) -> Vec<v1::Video> {
    service.videos().list_videos(request).await.unwrap().into_inner().videos
}

async fn models(service: &Running, request: v1::ListModelsRequest) -> Vec<v1::Model> {
    service.models().list_models(request).await.unwrap().into_inner().models
}

#[tokio::test(flavor = "multi_thread")]
async fn videos_and_set_ups_are_filtered_and_paged_and_have_times() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut names = vec![];
    for (name, setup, world) in [
        ("a", "lab/table 1", v1::World::Table),
        ("b", "lab/table 1", v1::World::Table),
        ("c", "lab/table 2", v1::World::AirTable),
        ("d", "", v1::World::Clevrer),
    ] {
        let posted = v1::Video { setup: setup.into(), world: world.into(), ..video(name, 20) };
        names.push(service.create(posted).await.unwrap());
    }
    let set = |videos: Vec<v1::Video>| videos.into_iter().map(|v| v.name).collect::<BTreeSet<_>>();
    let all = || v1::ListVideosRequest::default();
    let of_setup = v1::ListVideosRequest { setup: "lab/table 1".into(), ..all() };
    assert_eq!(set(videos(&service, of_setup).await), names[..2].iter().cloned().collect());
    let of_world = v1::ListVideosRequest { world: v1::World::AirTable.into(), ..all() };
    assert_eq!(set(videos(&service, of_world).await), names[2..3].iter().cloned().collect());
    let listed = videos(&service, all()).await;
    let first = listed.iter().filter_map(|v| v.create_time).map(|t| (t.seconds, t.nanos)).min().unwrap();
    let from = prost_types::Timestamp { seconds: first.0, nanos: first.1 };
    let since = v1::ListVideosRequest { created_from: Some(from), ..all() };
    assert_eq!(videos(&service, since).await.len(), 4);
    let before = v1::ListVideosRequest { created_before: Some(from), ..all() };
    assert_eq!(videos(&service, before).await, []);
    // Posting again changes no time.
    let again = v1::Video { setup: "lab/table 1".into(), world: v1::World::Table.into(), ..video("a", 20) };
    service.create(again).await.unwrap();
    assert_eq!(videos(&service, all()).await, listed);

    let mut pages = vec![];
    let mut request = v1::ListSetupsRequest { page_size: 1, prefix: "lab/".into(), ..Default::default() };
    loop {
        let page = service.videos().list_setups(request.clone()).await.unwrap().into_inner();
        pages.push(page.setups.into_iter().map(|s| (s.name, s.video_count)).collect::<Vec<_>>());
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    assert_eq!(pages, [[("lab/table 1".to_string(), 2)], [("lab/table 2".to_string(), 1)]]);
    let none = v1::ListSetupsRequest { prefix: "other".into(), ..Default::default() };
    assert_eq!(service.videos().list_setups(none).await.unwrap().into_inner().setups, []);

    let few = v1::ListVideosRequest { read_mask: paths(&["display_name", "objects.id"]), ..all() };
    let few = videos(&service, few).await;
    assert!(few.iter().all(|v| v.name.is_empty() && v.create_time.is_none() && v.display_name.len() == 1));
    assert!(few.iter().flat_map(|v| &v.objects).all(|o| o.color.is_empty() && o.shape.is_none()));
    let one = v1::GetVideoRequest { name: names[0].clone(), read_mask: paths(&["objects.samples.frame"]) };
    let one = service.videos().get_video(one).await.unwrap().into_inner();
    assert_eq!(one.objects[0].samples[7], v1::Sample { frame: 7, ..Default::default() });
    let wrong = v1::ListVideosRequest {
        world: 77,
        created_from: Some(prost_types::Timestamp { seconds: -1, nanos: 0 }),
        read_mask: paths(&["name", "colour"]),
        ..all()
    };
    let refused = service.videos().list_videos(wrong).await.unwrap_err();
    assert_eq!(fields(&refused), ["world", "created_from", "read_mask.paths[1]"]);
    let wrong =
        v1::ListSetupsRequest { page_token: "xyz".into(), prefix: "x".repeat(201), ..Default::default() };
    let refused = service.videos().list_setups(wrong).await.unwrap_err();
    assert_eq!(fields(&refused), ["prefix", "page_token"]);

    service.videos().delete_video(v1::DeleteVideoRequest { name: names[2].clone() }).await.unwrap();
    let left = service.videos().list_setups(v1::ListSetupsRequest::default()).await.unwrap().into_inner();
    assert_eq!(left.setups.len(), 1, "a set-up goes with its last video");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn models_and_revisions_are_filtered_and_paged() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let name = service.create(video("a", 30)).await.unwrap();
    let plain = service.fit(&name).await.unwrap().1;
    let study = v1::StudyRequest { videos: vec![name.clone()], ..Default::default() };
    let addition = Some(v1::add_effect_request::Addition::Effect("cubic_drag".into()));
    let request = v1::AddEffectRequest { study: Some(study), addition };
    let mut stream = service.models().add_effect(request).await.unwrap().into_inner();
    let mut revised = None;
    let mut phases = BTreeSet::new();
    while let Some(message) = stream.message().await.unwrap() {
        phases.extend(message.status.map(|at| at.phase()));
        if let Some(v1::add_effect_response::Event::Revised(found)) = message.event {
            revised = Some(found);
        }
    }
    let (before, after) = revised.map(|r| (r.before.unwrap(), r.after.unwrap())).unwrap();
    assert!(!phases.is_empty() && !phases.contains(&v1::Phase::Fitting), "{phases:?}");

    let of = |preset: &str| v1::ListModelsRequest {
        parent: name.clone(),
        preset: preset.into(),
        read_mask: paths(&["name", "create_time"]),
        ..Default::default()
    };
    let listed = models(&service, of("clevrer")).await;
    assert_eq!(listed.len(), 3, "the fit and two revisions: {listed:?}");
    assert!(listed.iter().any(|m| m.name == plain.name));
    assert!(listed.iter().all(|m| m.create_time.is_some() && m.model_json.is_empty()));
    assert_eq!(models(&service, of("billiards")).await, []);

    let all = || v1::ListRevisionsRequest { video: name.clone(), ..Default::default() };
    let mut pages = vec![];
    let mut request = v1::ListRevisionsRequest { page_size: 1, ..all() };
    loop {
        let page = service.models().list_revisions(request.clone()).await.unwrap().into_inner();
        pages.push(page.revisions);
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    assert!(pages.iter().all(|page| page.len() == 1 && page[0].create_time.is_some()));
    let mut found: Vec<_> = pages.concat();
    found.iter_mut().for_each(|revision| revision.create_time = None);
    found.sort_by_key(|revision| revision.revision);
    assert_eq!(found, [before, after.clone()]);
    let by_effect =
        v1::ListRevisionsRequest { effect: "cubic_drag".into(), read_mask: paths(&["models"]), ..all() };
    let found = service.models().list_revisions(by_effect).await.unwrap().into_inner().revisions;
    assert_eq!(found, [v1::Revision { models: after.models, ..Default::default() }]);
    let other = v1::ListRevisionsRequest { effect: "magnus".into(), ..all() };
    assert_eq!(service.models().list_revisions(other).await.unwrap().into_inner().revisions, []);
    let wrong = v1::GetModelRequest { name: plain.name, read_mask: paths(&["rmse.x"]), ..Default::default() };
    assert_eq!(fields(&service.models().get_model(wrong).await.unwrap_err()), ["read_mask.paths[0]"]);
    let missing = v1::ListModelsRequest { parent: "videos/00".into(), ..Default::default() };
    assert_eq!(service.models().list_models(missing).await.unwrap_err().code(), Code::NotFound);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn objects_that_a_video_does_not_show_come_back_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut posted = video("a", 20);
    let unseen = v1::Object { id: 77, samples: vec![], mass: Some(0.3), ..posted.objects[0].clone() };
    posted.objects.insert(0, unseen.clone());
    let name = service.create(posted.clone()).await.unwrap();
    let get = v1::GetVideoRequest { name: name.clone(), read_mask: None };
    let found = service.videos().get_video(get).await.unwrap().into_inner();
    assert_eq!(found.objects.last(), Some(&unseen));
    assert_eq!(found.objects[..found.objects.len() - 1], posted.objects[1..]);
    assert_eq!(service.create(found).await.unwrap(), name, "what came back is the same video");
    let listed = videos(&service, v1::ListVideosRequest::default()).await;
    assert_eq!(listed[0].objects.last(), Some(&unseen));
    service.stop().await;
}
