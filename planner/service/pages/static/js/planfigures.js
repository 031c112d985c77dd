// What every report states of a plan: the median of the samples and the expected cost, without samples as simulated.
export const endOf = (plan) => plan.stated_end_s ?? plan.p50_s ?? plan.done_s ?? plan.time_s;
export const lateEndOf = (plan) => plan.stated_late_end_s ?? plan.p95_s;
export const costOf = (plan) => plan.stated_cost ?? plan.expected_cost ?? plan.cost;
