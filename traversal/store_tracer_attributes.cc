// StoreTracer, its batches: rays through pages, and attributes of their hits where a job asks for them.
#include "traversal/attribute_fetch.h"
#include "traversal/store_tracer.h"
#include "traversal/store_tracer_worker.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {

// Runs worker.rays. Those that wait at a page of attributes have ended, and nothing else waits there.
StoreTracer::BatchCounters StoreTracer::trace_batch(Worker& worker, const TraceJob& job, storage::PageId page,
                                                    const std::byte* image, CrossingBuffer* crossings) {
  if (!has(job.config.fields, Field::attributes)) {
    return trace_rays(worker, job, page, image, crossings);
  }
  BatchCounters counters;
  const bool at_attributes = !worker.rays.empty() && worker.rays.front().attribute_step != AttributeStep::none;
  if (!at_attributes) {
    counters = trace_rays(worker, job, page, image, crossings);
  }
  AttributeContext context;
  context.places = attribute_places_;
  context.asked = attributes_for(job.config.fields);
  context.images = cache_->images();
  context.touched = worker.page_lane ? worker.page_lane->marks() : cache_->touched();
  for (RayState& ray : worker.rays) {
    if (ray.done && ray.has_hit) {
      begin_attributes(context, ray);
    }
  }
  worker.attributes.assign(worker.rays.size(), HitAttributes());
  if (config_.adversarial) {  // one page at a time
    if (!at_attributes) {
      return counters;
    }
    context.images = worker.lone_page->show(index_of(page), image);
  }
  fetch_attributes(context, worker.rays, worker.attributes);
  if (worker.page_lane) {
    worker.page_lane->end_batch(index_of(page), cache_->touched());
  }
  counters.kernel.pages_entered += context.pages_entered;
  counters.attributes_read = context.entries_read;
  counters.corrupt = counters.corrupt || context.corrupt;
  return counters;
}

}  // namespace raymill::traversal
