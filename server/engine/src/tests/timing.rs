//! x
use super::backend::Faults;
use super::harness::*;
use super::world::*;
use crate::*;
use earthshine_world::*;
#[test]
fn timing() {
    let shape = WorldShape { chunks: [12, 1, 10], patches_per_chunk_max: 100, links_per_patch: 300, has_occluders: true };
    let t = std::time::Instant::now();
    let world = RandomWorld::new(1, shape);
    eprintln!("{} patches, {} nnz, {:?}", world.patch_count(), world.index.chunks.iter().map(|c| c.nonzero_count).sum::<u64>(), t.elapsed());
    let config = EngineConfig { hysteresis: 0.1, look_ahead_s: 0.25, decoded_bytes_max: 4<<30, ..generous(2048) };
    let backends: BackendFactory = Box::new(|capacity| Ok(Box::new(earthshine_radiosity::CpuBackend::new(capacity).unwrap())));
    for fake in [true, false] {
    let mut h = if fake { 
        Harness::with_backends(world.clone(), config.clone(), Box::new(|c| Ok(Box::new(Null(vec![false; c as usize])))))
    } else {
        Harness::with_backends(world.clone(), config.clone(), Box::new(|capacity| Ok(Box::new(earthshine_radiosity::CpuBackend::new(capacity).unwrap()))))
    }.with_camera(Vec3::ZERO);
    h.light(ALICE, lamp(Vec3::ONE));
    let mut times = Vec::new();
    let mut phase = |h: &mut Harness, name: &str, n: usize, f: &dyn Fn(&mut Harness, usize)| {
        times.clear();
        let before = h.engine.stats().counters;
        for i in 0..n { f(h, i); 
            let mut commands = Vec::new();
            h.now_s += 1.0/60.0;
            let ev = std::mem::take(&mut h.events);
            let t = std::time::Instant::now();
            h.engine.tick(h.now_s, ev, &mut commands);
            times.push(t.elapsed().as_secs_f64()*1e3);
            for c in commands { if let Command::LoadTile{chunk} = c { let e = h.tile(chunk); h.events.push(e); } }
        }
        times.sort_by(f64::total_cmp);
        let c = h.engine.stats().counters.since(&before);
        eprintln!("fake {fake} {name}: median {:.2} max {:.2} ms; adds {} removes {} rays {} frames {}", times[n/2], times[n-1], c.adds, c.removes, c.rays, c.frames);
    };
    phase(&mut h, "fill", 60, &|_, _| ());
    h.engine.validate().unwrap();
    phase(&mut h, "rest", 30, &|_, _| ());
    phase(&mut h, "fly 10 m/s", 60, &|h, i| h.events.push(Event::Camera { session: ALICE, camera: Camera { position: Vec3::X * (i as f32 / 6.0), forward: Vec3::X, velocity: Vec3::X * 10.0 } }));
    phase(&mut h, "lamp", 30, &|h, i| h.light(ALICE, lamp(Vec3::ONE * (1.0 + i as f32 * 0.01))));
    h.engine.validate().unwrap();
    eprintln!("{:?}", h.engine.stats());
    }
    let _ = Faults::default(); let _ = backends;
}
struct Null(Vec<bool>);
use earthshine_radiosity::*;
impl Backend for Null {
    fn capacity(&self) -> u32 { self.0.len() as u32 }
    fn apply(&mut self, u: &[Update]) -> Result<ApplyStats, BackendError> { for u in u { match u { Update::Add{slot,..} => self.0[slot.0 as usize] = true, Update::Remove{slot} => self.0[slot.0 as usize] = false } } Ok(ApplyStats::default()) }
    fn is_taken(&self, s: Slot) -> bool { self.0[s.0 as usize] }
    fn set_sources(&mut self, _: &[Slot], _: &[Rgb], _: &[Rgb]) -> Result<(), BackendError> { Ok(()) }
    fn step(&mut self) -> Result<StepStats, BackendError> { Ok(StepStats::default()) }
    fn read_irradiance(&mut self, _: &[Slot], _: &mut [Rgb]) -> Result<(), BackendError> { Ok(()) }
    fn drift(&mut self, _: u64) -> f32 { 0.0 }
    fn resolve(&mut self) -> Result<(), BackendError> { Ok(()) }
}
