#include "traversal/store_tracer.h"

#include <algorithm>
#include <bit>
#include <optional>

#include "storage/io/volume_table.h"
#include "storage/pages/codec.h"
#include "traversal/attribute_fetch.h"
#include "traversal/engine_job.h"
#include "traversal/simd/float_mode.h"
#include "traversal/store_tracer_worker.h"
#include "traversal/trace_checks.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {
namespace {

// Rays of a job at the root page, of which push() adds no more.
constexpr std::uint32_t kMostAtRoot = 64 << 10;

// What a waiting ray keeps of its best hit. Ties are broken by ids: they are kept wherever the choice could show.
Field kept_fields(const TraceConfig& config, bool instances) {
  const Field ids = instances && config.mode == Mode::exact ? Field::ids | Field::instance_id : Field::ids;
  switch (config.query) {
    case Query::closest:
      return config.fields == Field::t               ? Field::t
             : has(config.fields, Field::attributes) ? without(config.fields, Field::attributes) | ids | Field::uv
                                                     : config.fields | ids;
    case Query::count:
      return Field::count;
    default:
      return Field::none;
  }
}

std::string volume_kernel_name(const TraceConfig& config) {
  return config.query == Query::spans ? "spans" : "transmittance/" + std::string(to_string(config.volume.method));
}

KeptCorners kept_corners(const TraceConfig& config) {
  return config.query == Query::closest && config.mode == Mode::exact ? KeptCorners::of_hit : KeptCorners::none;
}

}  // namespace

Result<std::shared_ptr<StoreTracer>> StoreTracer::create(std::shared_ptr<const storage::StoreFile> file,
                                                         const Config& config, storage::Ledger& ledger) {
  std::shared_ptr<StoreTracer> tracer(new StoreTracer(std::move(file), config, ledger));
  RAYMILL_ASSIGN_OR_RETURN(tracer->volumes_, storage::read_volumes(*tracer->file_));
  RAYMILL_RETURN_IF_ERROR(tracer->init());
  return tracer;
}

StoreTracer::StoreTracer(std::shared_ptr<const storage::StoreFile> file, const Config& config, storage::Ledger& ledger)
    : file_(std::move(file)),
      attribute_places_(file_->has_attributes()
                            ? storage::AttributePlaces(file_->header().attributes, file_->footer().attribute_page,
                                                       file_->header().page_bytes, file_->footer().geometry_count,
                                                       file_->page_count())
                            : storage::AttributePlaces()),
      config_(config),
      ledger_(ledger),
      scheduler_(file_->page_count(), make_read_policy(config.read_order, file_->page_count(), encoded_bytes(*file_))),
      was_read_(file_->page_count()) {}

Status StoreTracer::init() {
  StoreShare share = config_.share;
  share.bytes -= std::min(share.bytes, aside_bytes());
  RAYMILL_RETURN_IF_ERROR(plan_memory(share));
  const unsigned threads = config_.share.threads;
  storage::PageCache::Config cache{file_->page_count(), file_->header().page_bytes, plan_.frame_count, threads};
  cache.eviction = config_.eviction;
  if (const auto& trace = config_.page_trace) {
    RAYMILL_RETURN_IF_ERROR(trace->begin(file_->page_count(), plan_.frame_count));
    cache.on_evict = [trace](storage::PageId page) { trace->add(PageTrace::Event::evict, index_of(page)); };
  }
  if (config_.eviction == storage::EvictionKind::demand) {
    future_demand_ = std::make_shared<FutureDemand>(file_->page_count(), file_->rules().width);
  }
  RAYMILL_ASSIGN_OR_RETURN(cache_, storage::PageCache::create(cache, ledger_));
  const auto make_reader = config_.make_reader ? config_.make_reader : storage::make_page_reader;
  RAYMILL_ASSIGN_OR_RETURN(reader_, make_reader(file_, config_.io, plan_.read_depth, ledger_,
                                                [this](storage::PageArrival a) { on_arrival(a); }));
  RAYMILL_ASSIGN_OR_RETURN(workers_claim_, ledger_.claim(storage::Tag::decode, plan_.worker_bytes + aside_bytes()));
  turns_ = make_turns();
  storage::MappedMemory buffer(plan_.extent_bytes);
  if (buffer.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for rays on their way to disk"};
  }
  spiller_ = std::make_unique<RaySpiller>(*this, std::move(buffer));
  for (unsigned i = 0; i < threads; ++i) {
    if (config_.timeline) {
      config_.timeline->name_lane(i, "worker " + std::to_string(i));
    }
    threads_.emplace_back([this, i] { work(i); });
  }
  return {};
}

// Of what only tests and recordings have.
std::uint64_t StoreTracer::aside_bytes() const {
  const std::uint64_t worker = (config_.adversarial ? LonePage::bytes(file_->rules()) : 0) +
                               (config_.page_trace ? PageTrace::Lane::bytes(file_->page_count()) : 0);
  return config_.share.threads * worker;
}

StoreTracer::~StoreTracer() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_wake_.notify_all();
  for (std::thread& thread : threads_) {
    thread.join();
  }
  // The spiller's thread and the reader's ask for pages until they are gone, and that looks at the spiller.
  if (spiller_) {
    spiller_->stop();
  }
  reader_.reset();
}

Status StoreTracer::check_query(const TraceConfig& config) const {
  RAYMILL_RETURN_IF_ERROR(check(config));
  if (config.tolerance != 0 || config.tolerance_angle != 0) {
    RAYMILL_RETURN_IF_ERROR(check_tolerance(config));
    if (!file_->has_proxies()) {
      return {ErrorCode::invalid_argument, file_->path() +
                                               ": holds no proxies, which answers within a tolerance need; build it "
                                               "with --proxies, or leave the tolerance out"};
    }
    if (config_.layout == Layout::expanded) {
      return {ErrorCode::invalid_argument,
              file_->path() + ": the expanded layout has no proxies; with a tolerance use --layout auto"};
    }
  }
  if (is_of_fog(config.query)) {
    if (!looks_at(config.query, volumes_)) {
      return {ErrorCode::invalid_argument,
              file_->path() + ": holds no fog volume; build it from a .vdb that has one, or ask another query"};
    }
    return check(config.volume);
  }
  return {};
}

// Of what a job asks for, whatever its query answers.
Status StoreTracer::check_attributes(const TraceConfig& config) const {
  const storage::AttributeSet asked = attributes_for(config.fields);
  if (asked == 0) {
    return {};
  }
  if (const storage::AttributeSet lacked = asked & ~file_->header().attributes; lacked != 0) {
    return {ErrorCode::invalid_argument, file_->path() + ": keeps no " + storage::to_string_of(lacked) +
                                             " of its triangles; build it with --attributes " +
                                             storage::to_string_of(asked | file_->header().attributes) +
                                             ", or leave out the field " + to_string(fields_of(lacked))};
  }
  if (config_.layout == Layout::expanded) {
    return {ErrorCode::invalid_argument,
            file_->path() + ": the expanded layout has no attributes; for them use --layout auto"};
  }
  return check_attribute_query(config);
}

Result<std::unique_ptr<Job>> StoreTracer::start(const TraceConfig& config, std::shared_ptr<StoreTracer> self) {
  TraceJob::Setup setup;
  setup.config = config;
  RAYMILL_RETURN_IF_ERROR(check_attributes(config));
  setup.config.fields = answered_fields(config.query, config.fields);
  RAYMILL_RETURN_IF_ERROR(check_query(setup.config));
  const storage::PageRules rules = file_->rules();
  const KernelChoice choice{config.query, config.mode, rules.width};
  setup.kernel = find_kernel(config_.isa, choice);
  setup.expanded_kernel = find_expanded_kernel(config_.isa, choice);
  setup.kernel_name = std::string(to_string(config.query)) + "/mbvh" + std::to_string(rules.width) + "/bits" +
                      std::to_string(storage::kBitstackBits) + "/" + std::string(to_string(config.mode)) + "/" +
                      std::string(to_string(config_.isa));
  setup.start_page = root_page();
  setup.among_volumes = looks_at(config.query, volumes_);
  if (is_of_fog(config.query)) {
    RayState first;
    begin_volumes(config.query, config.volume, volumes_, first);
    setup.start_page = storage::PageId{first.page};
    setup.kernel_name = volume_kernel_name(config);
  }
  const bool attributes = has(setup.config.fields, Field::attributes);
  if (future_demand_ && !setup.among_volumes && !attributes) {
    setup.future_demand = std::make_unique<FutureDemand::Share>(future_demand_);
  }

  const RowsAsked rows{setup.config.fields, gives_lists(config.query), config.first};
  JobPlan plan = plan_job(plan_, rules.page_count, rows);
  setup.most_in_flight = plan.most_in_flight;
  const Field kept = kept_fields(setup.config, rules.object_level != 0);
  plan.waiting.layout = RecordLayout(kept, kept_corners(setup.config),
                                     {.skipped = config.skips,
                                      .mask = config.masks,
                                      .instance_id = has(kept | setup.config.fields, Field::instance_id),
                                      .normals = has(setup.config.fields, Field::normal),
                                      .texel = file_->has_masks(),
                                      .columns = has(setup.config.fields, Field::shading_normal),
                                      .org_rest = config.float64 && file_->has_origins()});
  plan.waiting.directory = config_.spill_directory;
  plan.window.spill_directory = plan.window.lists.directory = config_.spill_directory;

  const std::lock_guard lock(mutex_);
  RAYMILL_RETURN_IF_ERROR(layout_status_);
  if (jobs_.size() >= config_.share.max_jobs) {
    return {ErrorCode::busy_retry, file_->path() + ": " + std::to_string(jobs_.size()) +
                                       " jobs are running, as many as there is ray memory for; try again later"};
  }
  RAYMILL_ASSIGN_OR_RETURN(setup.waiting, WaitingRays::create(plan.waiting, ledger_));
  RAYMILL_ASSIGN_OR_RETURN(setup.window, ResultWindow::create(plan.window, ledger_));
  RAYMILL_ASSIGN_OR_RETURN(setup.crossings_claim,
                           ledger_.claim(storage::Tag::results, plan.crossings * sizeof(Crossing)));
  setup.crossings.resize(plan.crossings / config_.share.threads * config_.share.threads);
  // Which have the proxies, and the attributes.
  const bool through_pages = config.tolerance != 0 || config.tolerance_angle != 0 || attributes;
  if (fresh_claim_.bytes() > 0 && !through_pages) {
    RAYMILL_ASSIGN_OR_RETURN(setup.fresh,
                             FreshRays::create({config_.share.threads, config.skips, config.masks}, ledger_));
  }
  auto job = std::make_shared<TraceJob>(std::move(setup));
  jobs_.push_back(job);
  spiller_->wake();
  return std::unique_ptr<Job>(std::make_unique<EngineJob>(std::move(self), std::move(job)));
}

PageState StoreTracer::state_of(storage::PageId page) const {
  return cache_->resident(page) ? PageState::resident : cache_->absent(page) ? PageState::absent : PageState::reading;
}

void StoreTracer::work(unsigned index) {
  const IeeeScope ieee;
  Worker worker(index, *file_, config_);
  WorkLock lock(mutex_);
  while (true) {
    lock.report(stats_);
    wait_for_work(lock);
    if (stopping_) {
      return;
    }
    if (!arrivals_.empty()) {
      handle_arrival(worker, lock);
    } else if (can_expand()) {
      expand_page(worker, lock);
    } else if (const auto page = stalled_ ? std::nullopt : scheduler_.take_ready()) {
      run_batch(worker, *page, lock);
    } else if (has_fresh()) {
      run_fresh(worker, lock);
    }
    pump_reads();
  }
}

void StoreTracer::wait_for_work(WorkLock& lock) {
  const auto something_to_do = [this] {
    return stopping_ || !arrivals_.empty() || can_expand() || (scheduler_.has_ready() && !stalled_) || has_fresh();
  };
  if (something_to_do()) {
    return;
  }
  if (jobs_.empty()) {
    lock.sleep([&](auto& held) { work_wake_.wait(held, [&] { return something_to_do() || !jobs_.empty(); }); });
    return;
  }
  const auto begin = Timeline::Clock::now();
  ++stats_.stalls;
  lock.sleep([&](auto& held) { work_wake_.wait_for(held, kPushPatience, something_to_do); });
  stats_.idle_seconds += std::chrono::duration<double>(Timeline::Clock::now() - begin).count();
}

// Chunks that are kept for batches in hand: a ray of a batch may need one of its own.
std::uint32_t StoreTracer::low_water(const TraceJob& job) const {
  return std::min(config_.share.threads * (kBatchRays + kBatchSlack), job.waiting->pool().chunk_count() / 4);
}

// Whether push() may go on: rays that workers have not got round to yet would only take memory from those that wait.
bool StoreTracer::has_room(const TraceJob& job) const {
  return job.waiting->count(job.start_page) < kMostAtRoot &&
         job.waiting->free_chunks() >= low_water(job) + RaySpiller::kPushChunks;
}

void StoreTracer::unstall() {
  stalled_ = false;
  if (scheduler_.has_ready()) {
    work_wake_.notify_all();
  }
}

// Rays that may be taken out, each of which may come back to a chunk of its own; 0: there is no room for them, and the
// spiller makes some.
std::uint32_t StoreTracer::batch_size(const TraceJob& job) const {
  const std::uint32_t room = job.waiting->free_chunks();
  return room >= RaySpiller::kLeastRoom ? std::min(kBatchRays, room - kBatchSlack) : 0;
}

// The next job, in turn, that has what is looked for; null: none has.
std::shared_ptr<TraceJob> StoreTracer::next_job(const std::function<bool(const TraceJob&)>& has_it) {
  for (std::size_t i = 0; i < jobs_.size(); ++i) {
    const auto& job = jobs_[next_job_++ % jobs_.size()];
    if (has_it(*job)) {
      return job;
    }
  }
  return nullptr;
}

// Waking costs more than a small batch: only where whoever pushes can go on.
bool StoreTracer::push_goes_on(const TraceJob& job) const {
  const auto has_much_room = [&] {
    return takes_fresh(job) ? job.fresh->has_much_room()
                            : has_room(job) && job.waiting->count(job.start_page) <= kMostAtRoot / 2;
  };
  return (job.push_blocked && job.place_for_many()) || (job.push_needs_room && has_much_room());
}

void StoreTracer::run_batch(Worker& worker, storage::PageId page, WorkLock& lock) {
  const auto job = next_job([page](const TraceJob& it) { return it.waiting->count(page) > 0; });
  if (!job) {
    return;
  }
  const std::uint32_t size = batch_size(*job);
  if (size == 0) {
    scheduler_.give_back(page);
    stalled_ = true;
    spiller_->wake();
    return;
  }
  RayQueue batch = job->waiting->take(page, size);
  const std::uint32_t promised = batch.count;
  job->waiting->promise(promised);
  scheduler_.remove(page, batch.count);
  scheduler_.give_back(page);
  if (scheduler_.has_ready()) {
    work_wake_.notify_one();
  }
  ++job->batches_out;
  storage::PagePin pin = cache_->pin(worker.index);
  const std::byte* image = cache_->find(page);
  stats_.rays_at_root += page == root_page() ? batch.count : 0;
  lock.unlock();

  const auto begin = Timeline::Clock::now();
  worker.rays.clear();
  const RayPool& pool = job->waiting->pool();
  pool.for_each(batch, [&](const std::byte* record) {
    RayState& ray = worker.rays.emplace_back();
    pool.layout().unpack(record, ray);
    ray.page = index_of(page);
  });
  if (job->future_demand && image != nullptr) {
    job->future_demand->taken_up(worker.rays, image);
  }
  Gathering crossings(*this, worker, *job);
  const BatchCounters counters = trace_batch(worker, *job, page, image, crossings.buffer());
  crossings.hand_over();
  if (job->future_demand && image != nullptr) {
    job->future_demand->put_back(worker.rays, index_of(page), image);
  }
  pin.release();
  worker.parked.clear();
  for (std::uint32_t i = 0; i < worker.rays.size(); ++i) {
    if (!worker.rays[i].done) {
      worker.parked.emplace_back(worker.rays[i].page, i);
    }
  }
  std::sort(worker.parked.begin(), worker.parked.end());
  if (config_.timeline) {
    config_.timeline->span(worker.index, "rays", begin, "rays", worker.rays.size());
  }

  lock.lock();
  --job->batches_out;
  job->waiting->settle(promised);
  job->waiting->pool().release(batch);
  job->stats.nodes_visited += counters.kernel.nodes_visited;
  job->stats.pages_entered += counters.kernel.pages_entered;
  job->stats.triangles_tested += counters.kernel.triangles_tested;
  job->stats.proxies_taken += counters.kernel.proxies_taken;
  job->stats.masks_tested += counters.kernel.masks_tested;
  job->stats.texels_read += counters.kernel.texels_read;
  job->stats.attributes_read += counters.attributes_read;
  if (counters.corrupt && job->status.ok()) {
    job->status = {ErrorCode::corrupt, file_->path() +
                                           ": has pages whose references do not fit each other; build it "
                                           "again (`raymill verify` names the page)"};
  }
  bool chunk_done = false;
  if (job->status.ok()) {
    const Result<bool> settled = settle(worker, *job);
    chunk_done = settled && *settled;
    job->status = settled.status();
  }
  if (!job->status.ok()) {
    remove_job(*job);
  }
  if (config_.adversarial && cache_->resident(page)) {
    cache_->drop(page);
    scheduler_.dropped(page);
  }
  unstall();
  const bool idle = job->batches_out == 0 && !scheduler_.has_ready();
  if (chunk_done || push_goes_on(*job) || !job->status.ok() || idle) {
    job->changed.notify_all();
  }
}

// Hits that a worker has gathered join the lists of their rays.
void StoreTracer::take_crossings(TraceJob& job, std::span<const Crossing> crossings) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < crossings.size() && job.status.ok(); ++i) {
    job.status = job.window->add_hit(crossings[i].number, crossings[i].hit);
    ++job.stats.crossings;
  }
}

// Done rays complete their chunks; the others join the queues of the pages they need. True: a chunk is done.
Result<bool> StoreTracer::settle(Worker& worker, TraceJob& job) {
  bool chunk_done = false;
  const bool attributes = has(job.config.fields, Field::attributes);
  for (std::size_t i = 0; i < worker.rays.size(); ++i) {
    if (const RayState& ray = worker.rays[i]; ray.done) {
      const Result<bool> done =
          job.window->has_lists()
              ? Result<bool>(job.window->complete(ray.number, 1))
              : job.window->complete(ray.number, ray.hit, attributes ? worker.attributes[i] : kNoAttributes);
      RAYMILL_RETURN_IF_ERROR(done.status());
      chunk_done = chunk_done || *done;
      ++job.rays_done;
      job.stats.hits += ray.has_hit ? 1 : 0;
      job.stats.crossings += job.config.query == Query::count ? ray.hit.count : 0;
    }
  }
  job.last_done = TraceJob::Clock::now();
  job.stats.rays_parked += worker.parked.size();
  const RecordLayout& layout = job.waiting->pool().layout();
  for (std::size_t i = 0; i < worker.parked.size();) {
    const storage::PageId page{worker.parked[i].first};
    const std::size_t begin = i;
    for (; i < worker.parked.size() && worker.parked[i].first == index_of(page); ++i) {
      const RayState& ray = worker.rays[worker.parked[i].second];
      std::byte* record = job.waiting->append(page, layout.bytes(ray));
      if (record == nullptr) {
        // The promises to batches in hand did not hold.
        if (i > begin) {
          scheduler_.add(page, static_cast<std::uint32_t>(i - begin), state_of(page));
        }
        return Status(ErrorCode::budget_exceeded,
                      file_->path() + ": the memory for waiting rays ran out; give --memory some MiB more");
      }
      layout.pack(ray, record);
    }
    scheduler_.add(page, static_cast<std::uint32_t>(i - begin), state_of(page));
  }
  return chunk_done;
}

void StoreTracer::fail_waiting(storage::PageId page, const Status& status) {
  const auto jobs = jobs_;  // remove_job changes the list
  for (const auto& job : jobs) {
    if (job->waiting->count(page) > 0) {
      job->status = job->status.ok() ? status : job->status;
      remove_job(*job);
      job->changed.notify_all();
    }
  }
}

// Takes a job that has ended out of the queues. Rays that somebody holds are dropped when they come back.
void StoreTracer::remove_job(TraceJob& job) {
  for (std::uint32_t i = 0; i < file_->page_count(); ++i) {
    const storage::PageId page{i};
    if (const std::uint32_t rays = job.waiting->count(page); rays > 0) {
      scheduler_.remove(page, rays);
      RayQueue queue = job.waiting->take(page, rays);
      job.waiting->pool().release(queue);
    }
  }
  if (job.fresh) {
    job.fresh->clear();
  }
  std::erase_if(jobs_, [&](const auto& other) { return other.get() == &job; });
  next_job_ = 0;
}

}  // namespace raymill::traversal
