"""Tables, exports, figures and pages made from the results the planner hands over; nothing here simulates.

    results             result types of plans and of the study
    table, export, page, figures   a ranking or the study: for the terminal, JSON and CSV, a page, a map
    field_report        a field in figures, for the terminal
    day_results, day_table, day_export, day_figures, day_page   a day of several fields and fleets
    odds                probability and expected cost against count
    front, drawing, paths, timed   what pages draw, as numbers: time against count, the map, paths thinned
    landmarks, layers   where names and arrows stand on any map; the layers of the map that is a picture
    maps                the maps of a ranking as JSON, for programs that draw them
    leg_list, step_words   what each tractor does, in order: tables, JSON, and its words
    diagnosis_table, diagnosis_export, diagnosis_page   a diagnosis for the terminal, as JSON, as a page
    replay_report       a replayed run
    trials, trial_figures, agreement   the thesis's experiments, and how many of its numbers are met
    work_results, work_table, work_compare, work_taught   driven work: results, runs, beside a plan, what it taught
    parcels             the fields of a file
    guidance            lines of a plan for terminals and maps, one module a form, and their registry
    wording, diagnosis_words, effect_words   what results, diagnoses and effects are called
    fitting, plain, palette   tables that fit the console; values that JSON can hold; colours
    template            pages from templates: every one extends base.html.j2
"""
