"""Tables, exports, figures and pages made from the results of the planner; nothing here simulates."""
