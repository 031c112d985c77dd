"""From a request to ranked plans: inputs, executors, tasks, ranking, tables of many fields, diagnosis and study."""
